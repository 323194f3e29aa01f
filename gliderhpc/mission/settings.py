"""Settings of a mission's run, and their overrides by texts ``KEY=VALUE``."""

from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from typing import Any, TypeVar

from pydantic import ValidationError

from gliderhpc.errors import InputError
from gliderhpc.estimation.current_errors import CurrentSettings
from gliderhpc.estimation.settings import EstimationSettings, Settings
from gliderhpc.record_checks import CheckSettings
from gliderhpc.shipped import most_similar, nearest
from gliderhpc.yaml_text import parse_value, shown, split_assignment

PLATFORM_PREFIX = "platform."

SettingsModel = TypeVar("SettingsModel", bound=Settings)


class MissionSettings(EstimationSettings):
    """All settings of a run, stored with its archive."""

    current: CurrentSettings = CurrentSettings()
    inspect: CheckSettings = CheckSettings()


def parse_assignments(assignments: Iterable[str]) -> tuple[dict[str, str], dict[str, str]]:
    """Split ``KEY=VALUE`` texts into the run's settings and the platform's (prefix ``platform.`` removed).

    Raises
    ------
    InputError
        A text is not of the form ``KEY=VALUE``.
    """
    settings: dict[str, str] = {}
    platform: dict[str, str] = {}
    for text in assignments:
        key, value = split_assignment(text, "setting", "KEY=VALUE", "window.length=60")
        if key.startswith(PLATFORM_PREFIX):
            platform[key.removeprefix(PLATFORM_PREFIX)] = value
        else:
            settings[key] = value
    return settings, platform


def build_settings(base: Mapping[str, Any], assignments: Mapping[str, str]) -> MissionSettings:
    """Build the settings of a run from keyword values and dotted assignments, as `build_settings_of` does."""
    return build_settings_of(MissionSettings, base, assignments)


def build_settings_of(
    model: type[SettingsModel], base: Mapping[str, Any], assignments: Mapping[str, str]
) -> SettingsModel:
    """Build and validate settings of a model from keyword values and dotted assignments.

    Parameters
    ----------
    model : type
        Settings model.
    base : mapping
        Values by field.
    assignments : mapping of str to str
        Values as text by dotted key; they take precedence.

    Raises
    ------
    InputError
        A key is unknown (the known ones are listed) or a value is out of range.
    """
    values: dict[str, Any] = deepcopy(dict(base))
    known = sorted(_dotted_keys(model))
    for key, text in assignments.items():
        if key not in known:
            raise InputError(f"{_unknown(key, known)}; those of the hull begin with {PLATFORM_PREFIX}")
        node = values
        *parents, last = key.split(".")
        for parent in parents:
            node = node.setdefault(parent, {})
        node[last] = parse_value(text, key, "neither a number nor a word")
    return validated_settings(model, values)


def validated_settings(model: type[SettingsModel], *layers: Mapping[str, Any]) -> SettingsModel:
    """Build settings of a model from values by name; those of a section are in a mapping or have dotted names.

    Parameters
    ----------
    model : type
        Settings model.
    *layers : mapping
        Values; those of later layers replace those of earlier ones.

    Raises
    ------
    InputError
        A name is unknown (the known ones are listed) or a value is out of range.
    """
    nested: dict[str, Any] = {}
    for values in layers:
        _merge(nested, values)
    try:
        return model.model_validate(nested)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        if first["type"] == "extra_forbidden":
            known = sorted(_dotted_keys(model))
            raise InputError(_unknown(where, known)) from None
        label = f"`{where}`" if where else "settings"
        if first["type"] == "value_error":  # one of our own messages, which names the value
            raise InputError(f"{label}: {first['ctx']['error']}") from None
        raise InputError(f"{label}: {first['msg']}, not {shown(first['input'])}") from None


def _unknown(key: str, known: Sequence[str]) -> str:
    """Describe an unknown key, with the settings of the section that it names or resembles, or all if there is none."""
    sections = sorted({name.split(".")[0] for name in known if "." in name})
    section = most_similar(key.split(".")[0], sections) if "." in key else None
    of_section = "" if section is None else f" of {section}"
    listed = known if section is None else [name for name in known if name.startswith(f"{section}.")]
    return f"`{key}`: no such setting{nearest(key, known)}; the settings{of_section} are {', '.join(listed)}"


def _merge(into: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Add values to a tree of sections; dotted names and mappings go into their sections."""
    for key, value in values.items():
        node = into
        *parents, last = key.split(".")
        for parent in parents:
            node = node.setdefault(parent, {})
            if not isinstance(node, dict):
                raise InputError(f"{key}: {parent} is not a section of the settings")
        if isinstance(value, Settings):
            node[last] = value.model_dump(exclude_unset=True)
        elif isinstance(value, Mapping):
            section = node.get(last)
            node[last] = section = section if isinstance(section, dict) else {}
            _merge(section, value)
        else:
            node[last] = value


def _dotted_keys(model: type[Settings], prefix: str = "") -> Iterable[str]:
    """Yield every key in dotted form."""
    for name, field in model.model_fields.items():
        annotation = field.annotation
        if isinstance(annotation, type) and issubclass(annotation, Settings):
            yield from _dotted_keys(annotation, f"{prefix}{name}.")
        else:
            yield prefix + name
