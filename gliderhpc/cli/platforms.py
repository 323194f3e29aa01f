"""``gliderhpc platforms``: list of the hulls, or properties of one hull."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gliderhpc.cli import options
from gliderhpc.cli.console import results
from gliderhpc.cli.messages import Verb, echo
from gliderhpc.flight.steady_glide import (
    SteadyGlide,
    glide_table,
    glides_stably,
    growth_rate,
    least_glide_angle,
    munk_moment,
    sign_in_doubt,
    stall_depth,
    yaw_bracket,
)
from gliderhpc.platform import Platform, platform_text, read_platform, shipped_platforms

if TYPE_CHECKING:
    from gliderhpc.flight.glider import Glider

NET_MASSES = (0.2, 0.3, 0.4, 0.5)
PITCHES = (20.0, 25.0, 30.0, 35.0)

MAX_SIGN_DOUBT = 0.05
"""Maximum fraction of 15 % coefficient draws with the opposite sign for which the yaw moment determines a current."""


@click.command("platforms", cls=Verb)
@click.argument("name_or_file", required=False)
@click.option(
    "--net-mass", "net_masses", multiple=True, type=options.Finite(0, 1000, min_open=True), help="Net mass, kg."
)
@click.option(
    "--pitch",
    "pitches",
    multiple=True,
    type=options.Finite(0, 89, min_open=True),
    help="Magnitude of the pitch, degrees.",
)
@click.option(
    "--depth", type=options.Finite(), default=0.0, show_default=True, help="Depth at which the glides are balanced, m."
)
@click.option("--yaml", "as_yaml", is_flag=True, help="Print the platform file itself, as a template.")
def platforms(
    name_or_file: str | None,
    net_masses: tuple[float, ...],
    pitches: tuple[float, ...],
    depth: float,
    as_yaml: bool,
) -> None:
    """List the hulls, or show one with its steady glides, stability, stall depth and yaw moment.

    NAME_OR_FILE is a shipped hull's name or the path of a platform file. --net-mass and --pitch can be repeated.

    \b
    Examples:
      gliderhpc platforms
      gliderhpc platforms petrel-l
      gliderhpc platforms petrel-l --net-mass 0.35 --pitch 22 --depth 500
      gliderhpc platforms petrel-l --yaml > mine.yaml
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    console = results()
    if name_or_file is None:
        console.print(hull_list())
    elif as_yaml:
        echo(platform_text(name_or_file), nl=False)
    else:
        show(read_platform(name_or_file), console, net_masses or NET_MASSES, pitches or PITCHES, depth)


def hull_list() -> Table:
    """Return a table of the shipped hulls."""
    table = Table(title="hulls", title_justify="left")
    table.add_column("name", no_wrap=True)
    table.add_column("mass kg", justify="right")
    table.add_column("minimum glide angle deg", justify="right")
    table.add_column("source", overflow="fold")
    for name in shipped_platforms():
        platform = read_platform(name)
        angle = math.degrees(least_glide_angle(platform))
        table.add_row(name, f"{platform.mass.total:.1f}", f"{angle:.1f}", Text(platform.source.split(". ")[0]))
    return table


def show(
    platform: Platform, console: Console, net_masses: tuple[float, ...], pitches: tuple[float, ...], depth: float
) -> None:
    """Print steady glides, stability, stall depth and yaw moment of a hull.

    Parameters
    ----------
    platform : Platform
        The hull; each key must be valid, but a stable glide is not required.
    console : rich.console.Console
        Output.
    net_masses : tuple of float
        Magnitudes of the net mass, kg.
    pitches : tuple of float
        Magnitudes of the pitch, degrees.
    depth : float
        Depth at which the glides are balanced, m.
    """
    # This imports numba and the kernels, which the list of hulls does not need.
    from gliderhpc.flight.glider import Glider

    glider = Glider(platform)
    glides = glide_table(glider, net_masses, [math.radians(pitch) for pitch in pitches], depth)
    console.print(_facts(glider, net_masses))
    console.print(_glide_rows(glider, glides, depth))
    console.print(_yaw_rows(platform, glides))


def _facts(glider: Glider, net_masses: tuple[float, ...]) -> Table:
    platform = glider.platform
    table = Table(title=Text(platform.name), title_justify="left", show_header=False)
    table.add_column("what", style="bold", no_wrap=True)
    table.add_column("value", overflow="fold")
    stable = glides_stably(glider)
    for what, value in {
        "source": platform.source,
        "mass": f"{platform.mass.total:g} kg, including the moving battery of {platform.mass.battery:g} kg",
        "neutral volume": f"{platform.buoyancy.neutral_volume:g} cm3",
        "minimum glide angle": f"{math.degrees(least_glide_angle(platform)):.1f} deg diving, "
        f"{math.degrees(least_glide_angle(platform, heavy=False)):.1f} deg climbing",
        "stable": "yes, it has stable steady dives and climbs"
        if stable
        else "NO: no stable steady dive or climb, so run-mission refuses it",
        "stall depth": _stall_depths(platform, net_masses),
    }.items():
        table.add_row(what, Text(value))
    return table


def _stall_depths(platform: Platform, net_masses: tuple[float, ...]) -> str:
    if platform.buoyancy.compressibility is not None:
        return "depends on the water: buoyancy follows its measured density"
    if platform.buoyancy.depth_slope == 0.0:
        return "none: no gain in buoyancy with depth"
    # With a slope of the opposite sign the climb stalls.
    direction = math.copysign(1.0, platform.buoyancy.depth_slope)
    depths = [(direction * net_mass, stall_depth(platform, direction * net_mass)) for net_mass in net_masses]
    return ", ".join(f"{depth:.0f} m at {net_mass:+g} kg" for net_mass, depth in depths)


def _glide_rows(glider: Glider, glides: list[SteadyGlide], depth: float) -> Table:
    table = Table(title=f"steady glides at {depth:g} m", title_justify="left")
    for column in (
        "net mass\nkg",
        "pitch\ndeg",
        "speed\nm/s",
        "down\nm/s",
        "angle of\nattack deg",
        "glide\nangle deg",
        "trim\nmm",
        "stable",
        "mode\ns",
    ):
        table.add_column(column, justify="right")
    for glide in glides:
        rate = growth_rate(glider, glide)
        table.add_row(
            f"{glide.net_mass:+.2f}",
            f"{math.degrees(glide.pitch):+.1f}",
            f"{glide.speed:.3f}",
            f"{glide.depth_rate:+.3f}",
            f"{math.degrees(glide.angle_of_attack):+.2f}",
            f"{math.degrees(glide.glide_angle):+.1f}",
            f"{1e3 * glide.battery_position:+.1f}",
            "yes" if rate < 0.0 else "NO",
            f"{-1.0 / rate:.1f}" if rate < 0.0 else "grows",
        )
    table.caption = "trim: battery position of the glide; mode: e-folding time of the slowest perturbation"
    if not glides:
        table.caption = (
            "none: these paths are flatter than the minimum glide angle, or no net mass remains at this depth"
        )
    return table


def _yaw_rows(platform: Platform, glides: list[SteadyGlide]) -> Table:
    """Tabulate the net yaw moment at both ends of the glides' angles of attack."""
    angles = sorted({glide.angle_of_attack for glide in glides}) or [0.0]
    table = Table(title="yaw moment per u v, kg: sensitivity to a current", title_justify="left")
    for column in ("angle of attack deg", "viscous", "Munk", "sum", "opposite sign in draws of 15 %"):
        table.add_column(column, justify="right")
    doubts = []
    for alpha in dict.fromkeys((angles[0], angles[-1])):
        bracket, munk = yaw_bracket(platform, alpha), munk_moment(platform)
        doubts.append(sign_in_doubt(platform, alpha))
        table.add_row(
            f"{math.degrees(alpha):+.2f}",
            f"{bracket - munk:+.1f}",
            f"{munk:+.1f}",
            f"{bracket:+.1f}",
            f"{100 * doubts[-1]:.0f} %",
        )
    verdict = (
        "its sign is certain enough to infer a current"
        if max(doubts) <= MAX_SIGN_DOUBT
        else "its sign is too uncertain"
    )
    table.caption = f"{_munk_remainder(platform, angles)} of the Munk term remains; {verdict}"
    return table


def _munk_remainder(platform: Platform, angles: list[float]) -> str:
    munk = munk_moment(platform)
    if munk == 0.0:
        return "all"
    parts = sorted(100 * yaw_bracket(platform, alpha) / munk for alpha in (angles[0], angles[-1]))
    return f"{parts[0]:.0f} to {parts[1]:.0f} %"
