"""``gliderhpc report`` and ``export``: missions as HTML pages, and as files for other programs."""

from pathlib import Path

import click

from gliderhpc.cli import options
from gliderhpc.cli.main import DONE, FAILED
from gliderhpc.cli.messages import Verb, echo, print_left_out
from gliderhpc.errors import InputError
from gliderhpc.report.exports.currents import export_currents
from gliderhpc.report.exports.deployment import read_deployment
from gliderhpc.report.exports.og1 import ExportSummary, export_og1
from gliderhpc.report.exports.og1_vocabulary import SINGLE
from gliderhpc.report.page.report import write_report
from gliderhpc.store_schema.location import Location
from gliderhpc.wording import counted
from gliderhpc.yaml_text import split_assignment


@click.command("report", cls=Verb)
@click.argument("archives", nargs=-1, required=True, type=options.PLACE, metavar="ARCHIVE...")
@click.option(
    "--out",
    required=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the page, created if missing.",
)
@click.option("--profile", type=options.PROFILE_NUMBER, metavar="N", help="Write the page of this profile.")
@click.option(
    "--twins", type=click.Path(file_okay=False, path_type=Path), help="Output folder of `twin windows`, to include it."
)
@click.option(
    "--truth", type=click.Path(path_type=Path), help="Truth file of a synthetic mission, to draw with the profile."
)
def report(
    archives: tuple[Location, ...], out: Path, profile: int | None, twins: Path | None, truth: Path | None
) -> int:
    """Write ARCHIVE as one self-contained HTML page, its tables also as CSV and its figures as PNG and SVG.

    The page has an overview of the mission, the findings of every study in the archive, the commands that run the
    missing ones, and how to reproduce everything; with --profile it shows everything about one profile.

    Several archives get a page each, in a folder of their own, and one page of the fleet: a row for each glider with
    its last current, hull and anything unusual, and a map. Exit status 1: an archive cannot be read; its row says why.

    \b
    Examples:
      gliderhpc report mission.zarr --out report
      gliderhpc report mission.zarr --out report --profile 18
      gliderhpc report mission.zarr --out report --twins twins
      gliderhpc report sg033.zarr sg561.zarr --out fleet
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    if profile is not None and twins is not None:
        raise click.UsageError("--twins belongs to the page of the mission, not to that of a profile; leave one out")
    if len(archives) > 1 and any(option is not None for option in (profile, twins, truth)):
        raise click.UsageError(
            "--profile, --twins and --truth belong to one archive; leave them out of a fleet's report"
        )
    written = write_report(archives, out, profile=profile, twins=twins, truth=truth)
    for line in written.failed:
        echo(f"no page: {line}", err=True)
    echo(f"{len(written.figures)} figures and {len(written.tables)} tables in the folder of the page")
    echo(f"written to {written.page}")
    return FAILED if written.failed else DONE


@click.group("export")
def export() -> None:
    """Write a finished mission's results in another format.

    \b
    Examples:
      gliderhpc export og1 mission.zarr results.nc
      gliderhpc export currents mission.zarr currents.nc
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped


@export.command("og1", cls=Verb)
@click.argument("archive", type=options.PLACE, metavar="ARCHIVE.zarr")
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT.nc")
@click.option(
    "--attribute",
    "assignments",
    multiple=True,
    metavar="NAME=VALUE",
    help="A global attribute, such as contributor_name, or WMO_IDENTIFIER, PLATFORM_SERIAL_NUMBER ...; repeatable.",
)
@options.deployment
@click.option(
    "--community",
    is_flag=True,
    help="Write a strict file for data centres: the variables of the OG1 manual and nothing else.",
)
@options.overwrite
def og1(
    archive: Location,
    out: Path,
    assignments: tuple[str, ...],
    deployment: Path | None,
    community: bool,
    overwrite: bool,
) -> int:
    """Write ARCHIVE as an OceanGliders OG1 netCDF file: one row for each record and for each GPS fix.

    It contains measured attitude, depth and controls, disturbances and motion by adjoint and smoother, currents, and
    positions by dead reckoning between the fixes; with --community measured attitude and depth, positions and
    currents. Exit status 2: the archive is not finished.

    \b
    Examples:
      gliderhpc export og1 mission.zarr results.nc
      gliderhpc export og1 m12.zarr m12-og1.nc --attribute WMO_IDENTIFIER=6801706 --attribute "contributor_name=A. Name"
      gliderhpc export og1 m12.zarr m12-og1.nc --deployment deployment.yaml
      gliderhpc export og1 m12.zarr sea035_20190718T190000_delayed.nc --deployment deployment.yaml --community
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    described = ({} if deployment is None else read_deployment(deployment)) | _parse_attributes(assignments)
    _print(export_og1(archive, out, described=described, community=community, overwrite=overwrite))
    return DONE


@export.command("currents", cls=Verb)
@click.argument("archive", type=options.PLACE, metavar="ARCHIVE.zarr")
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT.nc")
@options.deployment
@options.overwrite
def currents(archive: Location, out: Path, deployment: Path | None, overwrite: bool) -> int:
    """Write the currents of ARCHIVE as CF netCDF for assimilation: one profile per dive, with errors and covariance.

    Requires the group of `gliderhpc analyze ARCHIVE.zarr currents`. The depth-averaged current is `u`, `v`.

    \b
    Example:
      gliderhpc export currents mission.zarr currents.nc
      gliderhpc export currents mission.zarr currents.nc --deployment deployment.yaml
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    described = {} if deployment is None else read_deployment(deployment)
    profiles, left_out = export_currents(archive, out, described=described, overwrite=overwrite)
    print_left_out(left_out)
    echo(f"currents of {counted(len(profiles), 'profile')}, written to {out}")
    return DONE


def _parse_attributes(assignments: tuple[str, ...]) -> dict[str, str]:
    described: dict[str, str] = {}
    for text in assignments:
        name, value = split_assignment(text, "--attribute", "NAME=VALUE", "contributor_name=...")
        if not name.isidentifier():
            raise InputError(f"--attribute {text}: '{name}' is not a valid name; use letters, digits and underscores")
        if name.isupper() and name not in _TEXTS:
            raise InputError(f"--attribute {name}: there is no such variable; give one of {', '.join(_TEXTS)}")
        described[name] = value
    return described


_TEXTS = tuple(name for name in SINGLE if not name.startswith("DEPLOYMENT_"))


def _print(summary: ExportSummary) -> None:
    print_left_out(summary.left_out)
    if summary.unknown:
        echo(f"note: OG1 requires {', '.join(summary.unknown)}; give each as --attribute NAME=VALUE")
    counts = (counted(len(summary.profiles), "profile"), counted(summary.rows, "row"))
    echo(f"{', '.join(counts)}, {counted(summary.fixes, 'fix', 'fixes')}, written to {summary.path}")
