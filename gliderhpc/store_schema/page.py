"""Tables of groups and variables in `docs/archive.md`, generated from the schema."""

from __future__ import annotations

from collections.abc import Iterator

from gliderhpc.store_schema.create import CODECS
from gliderhpc.store_schema.mission_groups import COMMITS, MISSION
from gliderhpc.store_schema.schema import PROFILE, TIME_UNITS, Group, Variable
from gliderhpc.store_schema.studies import STUDIES

_HEADINGS = ("variable", "dimensions", "type", "unit", "fill", "chunk", "standard name", "what it is")


def schema_page() -> str:
    """Render version, codecs and every variable of the mission's groups and of the studies'."""
    codecs = ", ".join(str(codec.to_dict()["name"]) for codec in CODECS)
    lines = [
        f"Schema {MISSION.version}. Every variable is compressed by the codecs {codecs} "
        f"({CODECS[0].to_dict()['configuration']}); times are seconds since 1970 (UTC) that CF-aware readers decode.",
        "",
        "### Mission",
        "",
    ]
    for group in MISSION:
        lines += _group_lines(group)
    lines += ["### Studies", "", "Each is there once its study has been run.", ""]
    for group in STUDIES:
        lines += _group_lines(group)
    return "\n".join(lines).rstrip()


def _group_lines(group: Group) -> Iterator[str]:
    yield f"#### `{group.name}`: {group.title}"
    yield ""
    yield f"| {' | '.join(_HEADINGS)} |"
    yield "|" + " --- |" * len(_HEADINGS)
    for variable in group.variables:
        yield f"| {' | '.join(_cells(group, variable))} |"
    yield ""


def _cells(group: Group, variable: Variable) -> tuple[str, ...]:
    names = [variable.standard_name or ""]
    if variable.attributes and "og1_name" in variable.attributes:
        names.append(f"OG1 {variable.attributes['og1_name']}")
    meanings = f" ({', '.join(f'{v} {k}' for k, v in variable.flags.meanings.items())})" if variable.flags else ""
    return (
        f"`{variable.name}`",
        ", ".join(variable.dims),
        variable.dtype,
        "s since 1970" if variable.units == TIME_UNITS else variable.units,
        "''" if variable.fill_value == "" else str(variable.fill_value),
        _chunk(group, variable),
        ", ".join(filter(None, names)),
        variable.long_name + meanings,
    )


def _chunk(group: Group, variable: Variable) -> str:
    if variable.is_row or (group.name == COMMITS and variable.name != PROFILE):
        return "one profile"
    return "all"
