"""``gliderhpc simulate-mission``: a synthetic mission with its truth."""

import logging
import math
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from gliderhpc.cli import options
from gliderhpc.cli.console import logging_to, progress, results
from gliderhpc.cli.main import DONE
from gliderhpc.cli.messages import Verb
from gliderhpc.flight.glider import load_platform
from gliderhpc.flight.hull_parameters import compressible
from gliderhpc.mission.executors import local_executor
from gliderhpc.mission.local_workers import default_workers
from gliderhpc.mission.warm import warm_simulator
from gliderhpc.platform import Platform
from gliderhpc.simulator import (
    MissionSummary,
    ProfileSummary,
    Scenario,
    check_mission_path,
    load_scenario,
    shipped_scenarios,
    simulate_mission,
)
from gliderhpc.wording import counted

log = logging.getLogger("gliderhpc.simulate")

MAX_TABLE_ROWS = 24
"""Maximum number of rows of the table; for a longer mission, every second, third, ... profile is listed."""

MAX_SERIAL_PROFILES = 8
"""Largest mission that is simulated in this process by default."""


@click.command("simulate-mission", cls=Verb)
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT.nc")
@options.platform
@click.option(
    "--scenario",
    "scenario_name",
    default="impulses",
    show_default=True,
    metavar="NAME_OR_FILE",
    help=f"A shipped scenario ({', '.join(shipped_scenarios())}), or a scenario file.",
)
@click.option("--profiles", type=options.PROFILE_COUNT, help="Number of profiles, instead of the scenario's.")
@click.option("--seed", type=options.SEED, default=0, show_default=True, help="Seed of all random numbers.")
@click.option(
    "--depth", type=options.Finite(), help="Depth at which dives turn into climbs, m, instead of the scenario's."
)
@options.workers
@options.overwrite
@options.log_file
def simulate(
    out: Path,
    platform_name: str,
    scenario_name: str,
    profiles: int | None,
    seed: int,
    depth: float | None,
    workers: int | None,
    overwrite: bool,
    log_file: Path | None,
) -> int:
    """Simulate a mission: write observations to OUT.nc, and their truth to OUT.truth.nc in the same folder.

    The same seed gives the same bytes, whatever the number of workers.

    \b
    Examples:
      gliderhpc simulate-mission twin.nc --platform petrel-l --profiles 4 --seed 1
      gliderhpc simulate-mission paper.nc --platform petrel-l --scenario paper --workers 2
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    scenario = load_scenario(scenario_name).replaced({"profiles": profiles, "depth": depth})
    platform = load_platform(platform_name)
    check_mission_path(out, overwrite=overwrite, inputs=(scenario_name, platform_name))
    count = _workers(scenario, workers)
    with logging_to(log_file), progress(scenario.profiles, "profiles") as advance:
        _note_ocean(platform, scenario)

        def on_profile(profile: ProfileSummary) -> None:
            minutes = profile.duration / 60.0
            log.info("profile %d: %.0f minutes to %.0f m simulated", profile.number, minutes, profile.max_depth)
            advance()

        with local_executor(count, warm_simulator) as executor:
            summary = simulate_mission(
                platform,
                out,
                scenario=scenario,
                seed=seed,
                run=executor.run,
                on_profile=on_profile,
                overwrite=overwrite,
            )
    _print(summary, results())
    return DONE


def _workers(scenario: Scenario, requested: int | None) -> int:
    if requested is None:
        return 0 if scenario.profiles <= MAX_SERIAL_PROFILES else default_workers()
    return min(requested, scenario.profiles)


def _note_ocean(platform: Platform, scenario: Scenario) -> None:
    """Log the compressibility assumed in the simulation if the platform file has none."""
    if scenario.ocean is None or platform.buoyancy.compressibility is not None:
        return
    buoyancy = compressible(platform).buoyancy
    log.info(
        "the platform %s states no buoyancy.compressibility; it is simulated with the usual %.2g 1/dbar and a thermal "
        "expansion of %.2g 1/K",
        platform.name,
        buoyancy.compressibility,
        buoyancy.thermal_expansion,
    )


def _print(summary: MissionSummary, console: Console) -> None:
    days = summary.elapsed / 86_400.0
    title = f"{counted(len(summary.profiles), 'profile')}, {int(days)} d {24.0 * (days % 1.0):.1f} h"
    table = Table(title=title, title_justify="left")
    for heading in ("profile", "start", "minutes", "depth\nm", "impulses", "north\nm/s", "east\nm/s"):
        table.add_column(heading, justify="right", no_wrap=True)
    every = math.ceil(len(summary.profiles) / MAX_TABLE_ROWS)
    for profile in summary.profiles[::every]:
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
