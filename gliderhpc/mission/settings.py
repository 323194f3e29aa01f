"""Settings of a mission's run, and the ``--set KEY=VALUE`` that change them."""

from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from pydantic import ValidationError

from gliderhpc.errors import InputError
from gliderhpc.estimation.current_errors import CurrentSettings
from gliderhpc.estimation.settings import EstimationSettings, Settings
from gliderhpc.tuning.record_checks import CheckSettings
from gliderhpc.yaml_text import parse_value, shown

PLATFORM_PREFIX = "platform."


Chosen = TypeVar("Chosen", bound=Settings)


class MissionSettings(EstimationSettings):
    """Everything a run can be told, stored with its archive."""

    current: CurrentSettings = CurrentSettings()
    inspect: CheckSettings = CheckSettings()


def parse_assignments(assignments: Iterable[str]) -> tuple[dict[str, str], dict[str, str]]:
    """Split ``KEY=VALUE`` texts into the run's settings and the platform's (prefix ``platform.`` taken off).

    Raises
    ------
    InputError
        A text is not of the form ``KEY=VALUE``.
    """
    settings: dict[str, str] = {}
    platform: dict[str, str] = {}
    for text in assignments:
        key, equals, value = text.partition("=")
        key = key.strip()
        if not equals or not key:
            raise InputError(f"--set {text}: write it as KEY=VALUE, for example --set window.length=60")
        if key.startswith(PLATFORM_PREFIX):
            platform[key.removeprefix(PLATFORM_PREFIX)] = value
        else:
            settings[key] = value
    return settings, platform


def build_settings(base: Mapping[str, Any], assignments: Mapping[str, str]) -> MissionSettings:
    """Settings of a run from keyword values and dotted assignments, as `build_settings_of` makes them."""
    return build_settings_of(MissionSettings, base, assignments)


def build_settings_of(model: type[Chosen], base: Mapping[str, Any], assignments: Mapping[str, str]) -> Chosen:
    """Settings of a kind from keyword values and dotted assignments, validated.

    Raises
    ------
    InputError
        An unknown key (the known ones are listed) or a value out of range.
    """
    values: dict[str, Any] = dict(base)
    known = sorted(_dotted(model))
    for key, text in assignments.items():
        if key not in known:
            raise InputError(
                f"--set {key}: no such setting; the settings are {', '.join(known)}, and {PLATFORM_PREFIX}..."
            )
        node = values
        *parents, last = key.split(".")
        for parent in parents:
            node = node.setdefault(parent, {})
        node[last] = parse_value(text, f"--set {key}", "neither a number nor a word")
    try:
        return model.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "settings"
        raise InputError(f"--set {where}: {first['msg']}, not {shown(first['input'])}") from None


def _dotted(model: type[Settings], prefix: str = "") -> Iterable[str]:
    """Every settable key, sections spelt out."""
    for name, field in model.model_fields.items():
        annotation = field.annotation
        if isinstance(annotation, type) and issubclass(annotation, Settings):
            yield from _dotted(annotation, f"{prefix}{name}.")
        else:
            yield prefix + name
