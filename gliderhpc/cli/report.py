"""``gliderhpc report``: a mission, or one profile of it, as a page to look at and to send."""

from pathlib import Path

import click

from gliderhpc.cli import options
from gliderhpc.cli.main import DONE
from gliderhpc.cli.messages import say
from gliderhpc.report.page import write_report
from gliderhpc.store_schema.place import Place


@click.command("report")
@click.argument("archive", type=options.PLACE)
@click.option(
    "--out",
    required=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the page, made if missing.",
)
@click.option("--profile", type=options.PROFILE_NUMBER, metavar="N", help="Look at this profile alone.")
@click.option(
    "--twins", type=click.Path(file_okay=False, path_type=Path), help="Folder that `twin windows` left, to show it too."
)
@click.option(
    "--truth", type=click.Path(path_type=Path), help="A synthetic mission's truth file, to draw it beside a profile."
)
def command(archive: Place, out: Path, profile: int | None, twins: Path | None, truth: Path | None) -> int:
    """Write ARCHIVE as one self-contained HTML page, its tables also as CSV and its figures as PNG and SVG.

    The page has the mission at a glance, what every study found that the archive holds, the commands that make those it
    does not, and how to reproduce it all; with --profile everything about one profile.

    \b
    Examples:
      gliderhpc report mission.zarr --out report
      gliderhpc report mission.zarr --out report --profile 18
      gliderhpc report mission.zarr --out report --twins twins
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    if profile is not None and twins is not None:
        raise click.UsageError("--twins belongs to the page of the mission, not to that of a profile")
    written = write_report(archive, out, profile=profile, twins=twins, truth=truth)
    say(f"{len(written.figures)} figures and {len(written.tables)} tables beside it")
    say(f"written to {written.page}")
    return DONE
