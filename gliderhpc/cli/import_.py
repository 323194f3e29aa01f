"""`gliderhpc import`: an instrument's own records into the observation format."""

from collections.abc import Iterable
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from gliderhpc.cli.console import results
from gliderhpc.observations.imported import ImportedProfile
from gliderhpc.observations.seaexplorer import ImportSummary, import_seaexplorer
from gliderhpc.observations.slocum import ImportSummary as SlocumSummary
from gliderhpc.observations.slocum import import_slocum


@click.group("import")
def command() -> None:
    """Turn an instrument's own records into an observation file.

    \b
    Example:
      gliderhpc import seaexplorer M010/ mission.nc
      gliderhpc import slocum from-glider/ mission.nc
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped


@command.command("seaexplorer")
@click.argument("sources", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="SOURCE...")
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT.nc")
@click.option("--linear-scale", default=0.5e-3, show_default=True, help="Battery travel a unit of LinPos (m).")
@click.option("--linear-zero", default=60.0, show_default=True, help="LinPos at which battery_position is zero.")
@click.option("--include-surfacing", is_flag=True, help="Count the surfacing manoeuvre as part of a profile.")
def seaexplorer(
    sources: tuple[Path, ...], out: Path, linear_scale: float, linear_zero: float, include_surfacing: bool
) -> None:
    """Import an ALSEAMAR SeaExplorer mission.

    SOURCE is a folder of *.gli.sub.* and *.pld1.sub.* files, or the files themselves.

    \b
    Example:
      gliderhpc import seaexplorer M010/ mission.nc
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    summary = import_seaexplorer(
        sources, out, linear_scale=linear_scale, linear_zero=linear_zero, include_surfacing=include_surfacing
    )
    _print(summary, results())


@command.command("slocum")
@click.argument("sources", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="SOURCE...")
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT.nc")
@click.option(
    "--cache", type=click.Path(path_type=Path), metavar="DIR",
    help="Folder of the cache files (*.cac).  [default: beside the binary files, or cac/ there]",
)  # fmt: skip
@click.option(
    "--declination", type=float, metavar="DEGREE",
    help="Magnetic declination, east positive.  [default: what the GPS receiver reports, m_gps_mag_var]",
)  # fmt: skip
@click.option("--battery-scale", default=1.0, show_default=True, help="Battery travel a metre of reported m_battpos.")
@click.option("--battery-zero", default=0.0, show_default=True, help="m_battpos (m) where battery_position is zero.")
def slocum(
    sources: tuple[Path, ...],
    out: Path,
    cache: Path | None,
    declination: float | None,
    battery_scale: float,
    battery_zero: float,
) -> int:
    """Import a Teledyne Slocum mission.

    SOURCE is a folder of binary files (*.dbd and *.ebd, *.sbd and *.tbd, *.mbd and *.nbd, compressed or not) or of
    netCDF files of native sensors, or the files themselves. Binary files need the extra `gliderhpc[slocum]`.

    \b
    Example:
      gliderhpc import slocum from-glider/ mission.nc --cache cache/
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    summary = import_slocum(
        sources, out, cache=cache, declination=declination, battery_scale=battery_scale, battery_zero=battery_zero
    )
    console = results()
    console.print(profile_table(summary.mission, "segments", summary.profiles))
    for line in _slocum_lines(summary):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    return 1 if summary.rejected else 0


def _slocum_lines(summary: SlocumSummary) -> list[str]:
    """Say what the table does not; what went wrong comes last but for the result."""
    dropped = ", ".join(f"{count} {reason}" for reason, count in summary.dropped.items()) or "none"
    return [
        *(profile.fault for profile in summary.profiles if profile.fault),
        *summary.notes,
        f"{summary.segments} flight records, {summary.rows} rows every {summary.sample_interval:.2f} s, "
        f"{summary.ctd_samples} with CTD; dropped: {dropped}",
        f"{summary.fixes} fixes; {summary.fixes_dropped} implausible ones left out",
        *(f"{path}: ends before its closing mark; what is before the cut is imported" for path in summary.cut_short),
        *(f"left out: {reason}" for reason in summary.rejected.values()),
        f"{len(summary.profiles)} profiles, {len(summary.complete)} complete, written to {summary.path}"
        + (f"; {len(summary.rejected)} files could not be read" if summary.rejected else ""),
    ]


def _print(summary: ImportSummary, console: Console) -> None:
    console.print(profile_table(summary.mission, "cycles", summary.profiles))
    for line in _lines(summary):
        console.print(line, highlight=False, markup=False, soft_wrap=True)


def _lines(summary: ImportSummary) -> list[str]:
    """Say what the table does not."""
    dropped = ", ".join(f"{count} {reason}" for reason, count in summary.rows_dropped.items()) or "none"
    return [
        *(profile.fault for profile in summary.profiles if profile.fault),
        *(f"cycle {cycle}: no profile: {reason}" for cycle, reason in summary.cycles_without_profile.items()),
        *(f"cycle {cycle}: no payload file, so no CTD" for cycle in summary.cycles_without_payload),
        f"{summary.rows} rows every {summary.sample_interval:g} s, {summary.ctd_samples} with CTD; dropped: {dropped}",
        f"{summary.fixes} fixes; {summary.fixes_dropped} implausible ones left out",
        f"{len(summary.profiles)} profiles, {len(summary.complete)} complete, written to {summary.path}",
    ]


def profile_table(title: str, parts: str, profiles: Iterable[ImportedProfile]) -> Table:
    """Tabulate the profiles that an import found; `parts` heads the column of the vehicle's own pieces."""
    table = Table(title=title)
    for heading in ("profile", parts, "start", "minutes", "samples", "depth m"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("usable")
    for profile in profiles:
        table.add_row(
            str(profile.number),
            "-".join(map(str, dict.fromkeys((profile.parts[0], profile.parts[-1])))),
            str(profile.start_time.astype("datetime64[m]")).replace("T", " "),
            f"{profile.duration / 60.0:.0f}",
            str(profile.samples),
            f"{profile.max_depth:.0f}",
            "yes" if profile.fault is None else "no",
        )
    return table
