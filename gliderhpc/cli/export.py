"""``gliderhpc export``: results of a finished mission in other formats."""

from pathlib import Path

import click

from gliderhpc.cli import options
from gliderhpc.cli.main import DONE
from gliderhpc.cli.messages import say
from gliderhpc.errors import InputError
from gliderhpc.report.currents_file import export_currents
from gliderhpc.report.og1 import ExportSummary, export_og1
from gliderhpc.report.og1.vocabulary import SINGLE
from gliderhpc.yaml_text import split_assignment

_MAX_SHOWN_FAILURES = 10


@click.group("export")
def command() -> None:
    """Write a finished mission's results in another format.

    \b
    Examples:
      gliderhpc export og1 mission.zarr results.nc
      gliderhpc export currents mission.zarr currents.nc
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped


@command.command("og1")
@click.argument("archive", type=click.Path(path_type=Path), metavar="ARCHIVE.zarr")
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT.nc")
@click.option(
    "--attribute",
    "assignments",
    multiple=True,
    metavar="NAME=VALUE",
    help="A global attribute, such as contributor_name, or WMO_IDENTIFIER, PLATFORM_SERIAL_NUMBER ...; repeatable.",
)
@options.overwrite
def og1(archive: Path, out: Path, assignments: tuple[str, ...], overwrite: bool) -> int:
    """Write ARCHIVE as an OceanGliders OG1 netCDF file: one row for each record and for each GPS fix.

    Measured attitude, depth and controls, disturbances and motion by adjoint and smoother, currents, positions by dead
    reckoning between the fixes. Exit status 2 for an archive that is not finished.

    \b
    Examples:
      gliderhpc export og1 mission.zarr results.nc
      gliderhpc export og1 m12.zarr m12-og1.nc --attribute WMO_IDENTIFIER=6801706 --attribute "contributor_name=A. Name"
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    _print(export_og1(archive, out, described=_parsed(assignments), overwrite=overwrite))
    return DONE


@command.command("currents")
@click.argument("archive", type=click.Path(path_type=Path), metavar="ARCHIVE.zarr")
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT.nc")
@options.overwrite
def currents(archive: Path, out: Path, overwrite: bool) -> int:
    """Write the currents of ARCHIVE as CF netCDF for assimilation: a profile for each dive, with errors and covariance.

    Requires the group of `gliderhpc analyze ARCHIVE.zarr currents`. The depth-averaged current is `u`, `v`.

    \b
    Example:
      gliderhpc export currents mission.zarr currents.nc
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    summary = export_currents(archive, out, overwrite=overwrite)
    _print_left_out(summary.left_out)
    say(f"currents of {len(summary.profiles)} profiles, written to {summary.path}")
    return DONE


def _parsed(assignments: tuple[str, ...]) -> dict[str, str]:
    described: dict[str, str] = {}
    for text in assignments:
        name, value = split_assignment(text, "--attribute", "NAME=VALUE", "contributor_name=...")
        if not name.isidentifier():
            raise InputError(f"--attribute {text}: '{name}' is no name; use letters, digits and underscores")
        if name.isupper() and name not in _TEXTS:
            raise InputError(f"--attribute {name}: no such variable; those that can be given are {', '.join(_TEXTS)}")
        described[name] = value
    return described


_TEXTS = tuple(name for name in SINGLE if not name.startswith("DEPLOYMENT_"))


def _print(summary: ExportSummary) -> None:
    _print_left_out(summary.left_out)
    if summary.unknown:
        say(f"note: OG1 requires {', '.join(summary.unknown)}: give them with --attribute NAME=VALUE")
    say(f"{len(summary.profiles)} profiles, {summary.rows} rows, {summary.fixes} fixes, written to {summary.path}")


def _print_left_out(left_out: dict[int, str]) -> None:
    for number, why in list(left_out.items())[:_MAX_SHOWN_FAILURES]:
        say(f"profile {number} left out: {why}")
    if len(left_out) > _MAX_SHOWN_FAILURES:
        say(f"{len(left_out) - _MAX_SHOWN_FAILURES} more left out")
