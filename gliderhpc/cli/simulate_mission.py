"""``gliderhpc simulate-mission``: a synthetic mission with its truth beside it."""

from pathlib import Path

import click
from rich.console import Console

from gliderhpc.cli.console import results
from rich.table import Table

from gliderhpc.flight.loading import load_platform
from gliderhpc.observations.synthetic import MissionSummary, ProfileSummary, Scenario, simulate_mission


@click.command("simulate-mission")
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT.nc")
@click.option("--platform", required=True, help="A shipped hull's name or a platform file.")
@click.option("--profiles", type=click.IntRange(min=1), help="Number of profiles.  [default: 4]")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of all random numbers.")
@click.option("--depth", type=float, help="Depth at which a dive is turned into a climb, m.  [default: 200]")
def command(out: Path, platform: str, profiles: int | None, seed: int, depth: float | None) -> None:
    r"""Simulate a mission: observations into OUT.nc, and what was true into OUT.truth.nc beside it.

    Slow axial, normal and pitching disturbances, impulses of the yaw moment, a uniform current a profile, actuators
    that lag their commands, sensors with their resolution and noise, GPS fixes. The same seed gives the same bytes.

    \b
    Example:
      gliderhpc simulate-mission twin.nc --platform petrel-l --profiles 4 --seed 1
    """
    scenario = Scenario().replaced({"profiles": profiles, "depth": depth})
    summary = simulate_mission(load_platform(platform), out, scenario=scenario, seed=seed, report=_log)
    _print(summary, results())


def _log(profile: ProfileSummary) -> None:
    click.echo(
        f"profile {profile.number}: {profile.duration / 60.0:.0f} minutes to {profile.max_depth:.0f} m simulated",
        err=True,
    )


def _print(summary: MissionSummary, console: Console) -> None:
    table = Table(title=f"{len(summary.profiles)} profiles", title_justify="left")
    for heading in ("profile", "start", "minutes", "depth\nm", "impulses", "north\nm/s", "east\nm/s"):
        table.add_column(heading, justify="right", no_wrap=True)
    for profile in summary.profiles:
        table.add_row(
            str(profile.number),
            str(profile.start.astype("datetime64[m]")).replace("T", " "),
            f"{profile.duration / 60.0:.0f}",
            f"{profile.max_depth:.0f}",
            str(profile.impulses),
            f"{profile.current_north:+.3f}",
            f"{profile.current_east:+.3f}",
        )
    console.print(table)
    for path in (summary.path, summary.truth_path):
        console.print(f"written to {path}", highlight=False, soft_wrap=True)
