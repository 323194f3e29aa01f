"""Write the part of ``docs/archive.md`` that is the schema, from the schema: ``python -m benchmarks.archive_schema``."""

from pathlib import Path

from benchmarks.sections import with_section
from gliderhpc.store_schema.schema import schema_page

PAGE = Path(__file__).resolve().parents[1] / "docs" / "archive.md"
SECTION = "schema"


def main() -> None:
    """Write the section."""
    PAGE.write_text(with_section(PAGE.read_text("utf-8"), SECTION, schema_page()), "utf-8")
    print(f"written to {PAGE}")


if __name__ == "__main__":
    main()
