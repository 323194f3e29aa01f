"""Arguments of the Python interface: hulls, profiles and settings in the forms that users pass."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml

from gliderhpc.errors import InputError
from gliderhpc.estimation.settings import Settings
from gliderhpc.flight.glider import Glider, load_platform
from gliderhpc.flight.steady_glide import glides_stably
from gliderhpc.mission.settings import validated_settings
from gliderhpc.observations.profile_numbers import select_profiles
from gliderhpc.platform import Platform

HullArgument = Platform | str | Path
"""A platform, the name of a shipped one, or the path of a platform file."""

Profiles = int | str | Iterable[int] | None
"""One profile number, several numbers, a string such as ``18:20,68``, or None for all."""

SettingsModel = TypeVar("SettingsModel", bound=Settings)


def platform_of(hull: HullArgument) -> Platform:
    """Return the platform given as an argument, loading it by name or path if necessary.

    Raises
    ------
    InputError
        Under the conditions of `gliderhpc.load_platform`, or if a platform made or changed in Python cannot glide.
    """
    if not isinstance(hull, Platform):
        return load_platform(hull)
    if not glides_stably(Glider(hull)):
        raise InputError(
            f"the platform {hull.name} has no stable steady dive and climb at usual ballast and pitch; check its "
            "masses, its damping, and K_M and K_MY"
        )
    return hull


def profiles_text(profiles: Profiles) -> str | None:
    """Return the chosen profiles as a string such as ``18:20,68``, or None for all.

    Raises
    ------
    InputError
        The choice is neither numbers nor a string.
    """
    if profiles is None or isinstance(profiles, str):
        return profiles
    if not isinstance(profiles, Iterable | int | np.integer):
        raise InputError(f"profiles={profiles!r}: give numbers, or a string such as '18:20,68'")
    numbers = np.atleast_1d(np.asarray(profiles)).tolist() if hasattr(profiles, "dtype") else profiles
    numbers = [numbers] if isinstance(numbers, int) else list(numbers)
    if not numbers or not all(map(is_whole, numbers)):
        raise InputError(f"profiles={profiles!r}: give numbers, or a string such as '18:20,68'")
    return ",".join(map(str, numbers))


def is_whole(value: object) -> bool:
    """Return whether a value is a whole number; booleans, which Python counts among these, are not."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def chosen_profile(available: Sequence[int], profile: int | None) -> int:
    """Return the number of the chosen profile, which may be omitted if only one is available.

    Raises
    ------
    InputError
        There is no such profile, or there are several and `profile` is None.
    """
    if not available:
        raise InputError("profile: none is available; all have failed, or none is done yet")
    if profile is None:
        if len(available) != 1:
            (first, last), count = (min(available), max(available)), len(available)
            raise InputError(f"profile: there are {count}, {first} to {last}; choose one, for example profile={first}")
        return available[0]
    if not is_whole(profile):
        raise InputError(f"profile={profile!r}: give the number of a profile")
    return select_profiles(available, str(profile), "profile")[0]


def settings_of(model: type[SettingsModel], settings: SettingsModel | None, named: Mapping[str, Any]) -> SettingsModel:
    """Return settings of a class: an object, keyword arguments, or an object with some of its values replaced.

    Parameters
    ----------
    model : type
        Class of the settings.
    settings : Settings, optional
        An object of this kind.
    named : mapping
        Values by name; those of a section as a mapping, or by dotted names.

    Raises
    ------
    InputError
        A name is unknown (the message lists the known ones), a value is out of range, or the object has another class.
    """
    if settings is None:
        return validated_settings(model, named)
    if not isinstance(settings, model):
        kind = type(settings).__name__
        raise InputError(f"settings is of type {kind}; give {model.__name__}, or keyword arguments")
    return validated_settings(model, settings.model_dump(exclude_unset=True), named) if named else settings


def assignments_of(named: Mapping[str, Any], prefix: str = "") -> tuple[str, ...]:
    """Return keyword arguments as ``KEY=VALUE`` strings, as for ``--set``, with sections as dotted names."""
    texts: list[str] = []
    for key, value in named.items():
        if isinstance(value, Settings):
            value = value.model_dump(exclude_unset=True)
        if isinstance(value, Mapping):
            texts.extend(assignments_of(value, f"{prefix}{key}."))
        else:
            texts.append(f"{prefix}{key}={_as_yaml(value)}")
    return tuple(texts)


def _as_yaml(value: Any) -> str:
    if isinstance(value, str):
        return value
    plain = value.tolist() if isinstance(value, np.generic | np.ndarray) else value
    if isinstance(plain, list | tuple):
        plain = [item.tolist() if isinstance(item, np.generic) else item for item in plain]
    return str(yaml.safe_dump(plain, default_flow_style=True, width=10_000)).removesuffix("...\n").strip()
