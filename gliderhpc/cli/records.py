"""``gliderhpc import`` and ``inspect``: import of an instrument's files, and checks of the records."""

import json
import math
from collections.abc import Sequence
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from gliderhpc.api.import_options import NUMBERS
from gliderhpc.api.records import IMPORTERS, inspect_open, kind_of
from gliderhpc.cli import options
from gliderhpc.cli.console import logging_to, results, table
from gliderhpc.cli.main import DONE
from gliderhpc.cli.messages import Verb, echo, print_left_out, with_options
from gliderhpc.flight.glider import load_platform
from gliderhpc.mission.settings import build_settings, parse_assignments
from gliderhpc.observations import open_observations
from gliderhpc.observations.importing.workflow import ImportedProfile, ImportSummary
from gliderhpc.observations.instruments.og1 import import_og1
from gliderhpc.observations.instruments.seaexplorer import import_seaexplorer
from gliderhpc.observations.instruments.seaglider import import_seaglider
from gliderhpc.observations.instruments.slocum import import_slocum
from gliderhpc.output_files import check_output, write_text
from gliderhpc.record_checks import Inspection
from gliderhpc.record_checks.finding import HEADINGS
from gliderhpc.wording import counted


@click.group("import")
def import_() -> None:
    """Convert an instrument's files into an observation file.

    \b
    Examples:
      gliderhpc import any from-glider/ mission.nc
      gliderhpc import seaexplorer M010/ mission.nc
      gliderhpc import slocum from-glider/ mission.nc
      gliderhpc import seaglider sg249/ mission.nc
      gliderhpc import og1 sg033_delayed.nc mission.nc
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped


@import_.command("any", cls=Verb)
@options.sources("FILE...")
@options.records_out
@options.overwrite
def any_(sources: tuple[Path, ...], out: Path, overwrite: bool) -> int:
    """Import files whose kind is recognised by name or content, with the defaults of the importer.

    FILE is anything that the other import commands take: SeaExplorer text, Slocum binary or sensors in netCDF,
    Seaglider dives, OG1 with controls. For other files (pyglider, OG1 without controls, IOOS, ERDDAP) one line says
    what is missing for the inversion, and whether `gliderhpc currents` can use them.

    \b
    Example:
      gliderhpc import any sg249/ mission.nc
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    kind = kind_of(sources)
    echo(f"records of kind {kind}; for its options see gliderhpc import {kind} --help")
    return _print_summary(IMPORTERS[kind](sources, out, overwrite=overwrite), results())


@import_.command("seaexplorer", cls=Verb)
@options.sources("SOURCE...")
@options.records_out
@click.option(
    "--linear-scale",
    type=options.Finite(*NUMBERS["linear_scale"].limits),
    default=0.5e-3,
    show_default=True,
    help="Battery travel per unit of LinPos (m).",
)
@click.option(
    "--linear-zero",
    type=options.Finite(*NUMBERS["linear_zero"].limits),
    default=60.0,
    show_default=True,
    help="LinPos at which battery_position is zero.",
)
@click.option("--include-surfacing", is_flag=True, help="Count the surfacing manoeuvre as part of a profile.")
@options.declination()
@options.overwrite
def seaexplorer(
    sources: tuple[Path, ...],
    out: Path,
    linear_scale: float,
    linear_zero: float,
    include_surfacing: bool,
    declination: float | None,
    overwrite: bool,
) -> int:
    """Import an ALSEAMAR SeaExplorer mission.

    SOURCE is a folder of *.gli.sub.* files and of *.pld1.raw.* (delayed mode) or *.pld1.sub.* (real time), plain or
    gzipped, or the files themselves; several folders may be given. A mission without a CTD is imported too.

    \b
    Example:
      gliderhpc import seaexplorer M010/ mission.nc
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    summary = import_seaexplorer(
        sources,
        out,
        linear_scale=linear_scale,
        linear_zero=linear_zero,
        include_surfacing=include_surfacing,
        declination=declination,
        overwrite=overwrite,
    )
    return _print_summary(summary, results())


@import_.command("slocum", cls=Verb)
@options.sources("SOURCE...")
@options.records_out
@click.option(
    "--cache",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Folder of the cache files (*.cac).  [default: next to the binary files, or cac/ there]",
)
@options.declination(".  [default: what the GPS receiver reports, m_gps_mag_var]")
@click.option(
    "--battery-scale",
    type=options.Finite(*NUMBERS["battery_scale"].limits),
    default=1.0,
    show_default=True,
    help="Battery travel per metre of reported m_battpos.",
)
@click.option(
    "--battery-zero",
    type=options.Finite(*NUMBERS["battery_zero"].limits),
    default=0.0,
    show_default=True,
    help="m_battpos (m) where battery_position is zero.",
)
@options.overwrite
def slocum(
    sources: tuple[Path, ...],
    out: Path,
    cache: Path | None,
    declination: float | None,
    battery_scale: float,
    battery_zero: float,
    overwrite: bool,
) -> int:
    """Import a Teledyne Slocum mission.

    SOURCE is a folder of binary files (*.dbd and *.ebd, *.sbd and *.tbd, *.mbd and *.nbd, compressed or not) or of
    netCDF files of native sensors, or the files themselves. Binary files need the extra `gliderhpc[slocum]`.

    \b
    Example:
      gliderhpc import slocum from-glider/ mission.nc --cache cache/
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    summary = import_slocum(
        sources,
        out,
        cache=cache,
        declination=declination,
        battery_scale=battery_scale,
        battery_zero=battery_zero,
        overwrite=overwrite,
    )
    return _print_summary(summary, results())


@import_.command("seaglider", cls=Verb)
@options.sources("SOURCE...")
@options.records_out
@options.declination()
@options.overwrite
def seaglider(sources: tuple[Path, ...], out: Path, declination: float | None, overwrite: bool) -> int:
    """Import a Seaglider mission from the basestation's per-dive netCDF.

    SOURCE is a folder of pGGGDDDD.nc files, or the files themselves.

    \b
    Example:
      gliderhpc import seaglider sg249/ mission.nc
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    return _print_summary(import_seaglider(sources, out, declination=declination, overwrite=overwrite), results())


@import_.command("og1", cls=Verb)
@options.sources("SOURCE...")
@options.records_out
@options.declination()
@options.overwrite
def og1(sources: tuple[Path, ...], out: Path, declination: float | None, overwrite: bool) -> int:
    """Import OceanGliders OG1 netCDF with attitude and ballast volume.

    SOURCE is one or more OG1 files of one glider, or a folder of them. A file without ballast volume is left out, since
    there is nothing to invert.

    \b
    Example:
      gliderhpc import og1 sg033_delayed.nc mission.nc
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    return _print_summary(import_og1(sources, out, declination=declination, overwrite=overwrite), results())


def _print_summary(summary: ImportSummary, console: Console) -> int:
    """Print the summary and return the exit status: 1 if a file could not be used, or no profile can be inverted."""
    console.print(profile_table(summary.mission, summary.pieces, summary.profiles))
    for line in summary_lines(summary):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    return 1 if summary.rejected or not summary.complete else DONE


def summary_lines(summary: ImportSummary) -> list[str]:
    """Return the lines below the table; excluded files come just before the last line, the result."""
    dropped = ", ".join(f"{count} {reason}" for reason, count in summary.rows_dropped.items()) or "none"
    pieces = summary.pieces
    names = ("file", "files") if pieces == "files" else (f"{pieces.removesuffix('s')} or file", f"{pieces} or files")
    left_out = counted(len(summary.rejected), *names)
    every = f" every {summary.sample_interval:.4g} s" if math.isfinite(summary.sample_interval) else ""
    return [
        *(profile.fault for profile in summary.profiles if profile.fault),
        *(f"{what}: no profile: {reason}" for what, reason in summary.without_profile.items()),
        *summary.remarks,
        f"{counted(summary.rows, 'row')}{every}, {summary.ctd_samples} with CTD; dropped: {dropped}",
        f"{counted(summary.fixes, 'fix', 'fixes')}; {counted(summary.fixes_dropped, 'implausible one')} left out",
        *(f"{what}: left out: {reason}" for what, reason in summary.rejected.items()),
        f"{counted(len(summary.profiles), 'profile')}, {len(summary.complete)} complete, written to {summary.path}"
        + (f"; {left_out} left out" if summary.rejected else ""),
    ]


def profile_table(title: str, pieces: str, profiles: Sequence[ImportedProfile]) -> Table:
    """Tabulate the profiles found by an import, with the vehicle's own pieces (cycles, dives), if it has any."""
    table = Table(title=title)
    headings = (pieces,) if any(profile.parts for profile in profiles) else ()
    for heading in ("profile", *headings, "start", "minutes", "samples", "depth m"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("usable")
    for profile in profiles:
        ends = "-".join(map(str, dict.fromkeys((*profile.parts[:1], *profile.parts[-1:]))))
        table.add_row(
            str(profile.number),
            *(ends for _ in headings),
            str(profile.start_time.astype("datetime64[m]")).replace("T", " "),
            f"{profile.duration / 60.0:.0f}",
            str(profile.samples),
            f"{profile.max_depth:.0f}",
            "yes" if profile.fault is None else "no",
        )
    return table


_WORDS = ("check", "quantity", "unit", "verdict")


@click.command("inspect", cls=Verb)
@click.argument("observations", type=click.Path(path_type=Path))
@options.platform
@options.profiles
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE.json", help="Also write JSON.")
@options.assignments
@options.overwrite
@options.log_file
def inspect(
    observations: Path,
    platform_name: str,
    profiles: str | None,
    out: Path | None,
    assignments: tuple[str, ...],
    overwrite: bool,
    log_file: Path | None,
) -> int:
    """Check the records of OBSERVATIONS: lag of depth behind attitude, offset and scale of the pitch, compass.

    Each finding has its size, its standard error and the setting that would correct it. Nothing is corrected
    automatically: give the suggested setting to run-mission. Calibrate the hull first.

    \b
    Examples:
      gliderhpc inspect mission.nc --platform sea035.yaml
      gliderhpc inspect mission.nc --platform sea035.yaml --out checks.json --set inspect.profiles=200
      gliderhpc inspect mission.nc --platform sea035.yaml --set records.pitch_offset=0.9
      gliderhpc inspect mission.nc --platform sea035.yaml --set records.pitch_scale=0.86
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    values, platform_values = parse_assignments(assignments)
    settings = build_settings({}, values)
    platform = load_platform(platform_name, platform_values)
    if out is not None:
        check_output(out, overwrite=overwrite, inputs=(observations, platform_name), instead="another `out`")
    with logging_to(log_file), open_observations(observations) as opened:
        inspection = inspect_open(opened, platform, settings, profiles)
    _print_findings(inspection)
    if out is not None:
        write_text(out, with_options(json.dumps(inspection.as_json(), indent=2)) + "\n", overwrite=overwrite)
        echo(f"written to {out}")
    return DONE


def _print_findings(inspection: Inspection) -> None:
    print_left_out(inspection.left_out)
    rows = [finding.cells[:7] for finding in inspection.findings]
    results().print(table(f"records of {counted(len(inspection.profiles), 'profile')}", rows, HEADINGS[:7], _WORDS))
    for finding in inspection.findings:
        echo(f"{finding.quantity}: {finding.remark}")
    for finding in inspection.found:
        echo(f"suggested for {finding.quantity}: {finding.suggestion}")
