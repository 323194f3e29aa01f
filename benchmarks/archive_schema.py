"""Write the tables of the schema into the documentation: ``python -m benchmarks.archive_schema``.

``docs/archive.md`` lists the groups, ``docs/archive-variables.md`` every variable.
"""

from collections.abc import Iterator
from pathlib import Path

from benchmarks.sections import with_section
from gliderhpc.findings.formatting import markdown
from gliderhpc.store_schema import MISSION, STUDIES
from gliderhpc.store_schema.schema import CODECS, COMMITS, PROFILE, TIME_UNITS, ArchiveVariable, Group

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE = DOCS / "archive.md"
VARIABLES_PAGE = DOCS / "archive-variables.md"

_HEADINGS = ("variable", "dimensions", "type", "unit", "fill", "chunk", "standard name", "meaning")


def group_table() -> str:
    """Render the table of the groups: dimensions and content."""
    rows = [[f"`{group.name}`", ", ".join(group.dims), group.title] for group in (*MISSION, *STUDIES)]
    return markdown(("group", "dimensions", "content"), rows)


def variable_tables() -> str:
    """Render version, codecs, and one table for each group of mission and studies, with every variable."""
    codecs = ", ".join(str(codec.to_dict()["name"]) for codec in CODECS)
    lines = [
        f"Schema {MISSION.version}. Every variable is compressed by the codecs {codecs} "
        f"({CODECS[0].to_dict()['configuration']}); times are seconds since 1970 (UTC) that CF-aware readers decode.",
        "",
        "## Mission",
        "",
    ]
    for group in MISSION:
        lines += _group_lines(group)
    lines += ["## Studies", "", "Each exists once its study has been run.", ""]
    for group in STUDIES:
        lines += _group_lines(group)
    return "\n".join(lines).rstrip()


def _group_lines(group: Group) -> Iterator[str]:
    yield f"### `{group.name}`: {group.title}"
    yield ""
    yield markdown(_HEADINGS, [_cells(group, variable) for variable in group.variables])
    yield ""


def _cells(group: Group, variable: ArchiveVariable) -> tuple[str, ...]:
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


def _chunk(group: Group, variable: ArchiveVariable) -> str:
    if variable.is_row or (group.name == COMMITS and variable.name != PROFILE):
        return "one profile"
    return "all"


def main() -> None:
    """Write both sections."""
    for page, section, content in ((PAGE, "groups", group_table()), (VARIABLES_PAGE, "schema", variable_tables())):
        page.write_text(with_section(page.read_text("utf-8"), section, content), "utf-8")
        print(f"written to {page}")


if __name__ == "__main__":
    main()
