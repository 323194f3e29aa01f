"""A page's content into files: HTML that holds everything, and tables and figures beside it."""

from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from gliderhpc.findings.files import write_csv
from gliderhpc.output_folder import filled_aside
from gliderhpc.report.page import cells
from gliderhpc.report.page.content import Grid, Page, Picture
from gliderhpc.report.page.pictures import Embedded, embed
from gliderhpc.version import __version__


@dataclass(frozen=True)
class Written:
    """What a report left: its page, tables and figures (those as PNG)."""

    page: Path
    tables: tuple[Path, ...]
    figures: tuple[Path, ...]


def write_page(page: Page, folder: Path, name: str, made: str) -> Written:
    """Render a page into a folder.

    Parameters
    ----------
    page : Page
        What it holds.
    folder : Path
        Made where it is missing; files of the same names are replaced.
    name : str
        Of the page's file.
    made : str
        When and from what, for the page's foot.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    blocks = [block for section in page.sections for block in section.blocks]
    with filled_aside(folder) as aside:
        figures = {block.stem: embed(block.figure, aside, block.stem) for block in blocks if isinstance(block, Picture)}
        tables = [write_csv(aside / f"{block.stem}.csv", block.rows) for block in blocks if isinstance(block, Grid)]
        (aside / name).write_text(_html(page, figures, made), "utf-8")
    return Written(
        folder / name, tuple(folder / table.name for table in tables), tuple(folder / f.png for f in figures.values())
    )


def _html(page: Page, figures: dict[str, Embedded], made: str) -> str:
    environment = Environment(
        loader=PackageLoader("gliderhpc.report.page"), autoescape=True, trim_blocks=True, lstrip_blocks=True,
        undefined=StrictUndefined,
    )  # fmt: skip
    environment.filters["cell"] = cells.cell
    environment.tests["prose"] = cells.is_long
    environment.globals.update(columns_of=cells.columns_of, shown_rows=cells.shown_rows, left_out=cells.left_out)
    return environment.get_template("page.html").render(page=page, figures=figures, made=made, version=__version__)
