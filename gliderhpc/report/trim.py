"""Ballast, battery and offsets of the sensors from the dives so far, in the units that a pilot uses."""

from collections.abc import Iterator
from dataclasses import dataclass

from gliderhpc.platform import Platform
from gliderhpc.report.recent_hull import RecentHull
from gliderhpc.report.surfacing_message import Trim

IMPLAUSIBLE = 3.0
"""Distance from the platform file, in plausible deviations, beyond which something other than the hull is wrong."""

UNDETERMINED = 0.9
"""Remaining fraction of the plausible deviation from which the dives do not determine a parameter."""


@dataclass(frozen=True)
class PilotUnit:
    """A quantity that a pilot can change or correct: one number of the platform file in another unit.

    Attributes
    ----------
    parameter : str
        Key in the platform file.
    quantity, unit : str
        Name of the quantity, and its unit.
    scale : float
        Factor from the unit of the platform file; negative for ballast, as a hull of larger neutral volume is heavier.
    remark : str
        Condition under which the quantity applies; empty if there is none.
    """

    parameter: str
    quantity: str
    unit: str
    scale: float
    remark: str = ""


def pilot_units(platform: Platform) -> tuple[PilotUnit, ...]:
    """Return the quantities of a hull that a pilot can change or correct."""
    density, apart = platform.buoyancy.water_density, "last dive minus platform file"
    condition = f"in water of {density:g} kg/m3, to float as the platform file states"
    return (
        PilotUnit("buoyancy.neutral_volume", f"neutral oil volume, {apart}", "cm3", 1.0),
        PilotUnit("buoyancy.neutral_volume", "equivalent ballast to add", "g", -1e-3 * density, condition),
        PilotUnit("position.battery", f"battery zero, {apart}", "mm", 1e3),
        PilotUnit("sensors.pitch_offset", f"offset of the pitch, {apart}", "degree", 1.0),
        PilotUnit("sensors.roll_offset", f"offset of the roll, {apart}", "degree", 1.0),
        PilotUnit("sensors.heading_offset", f"offset of the heading, {apart}", "degree", 1.0),
    )


def trim_of(hull: RecentHull) -> Iterator[Trim]:
    """Yield the quantities whose deviation, after a calibration and the dives, is below `UNDETERMINED`."""
    mission, last = hull.mission, hull.found.smoothed[-1]
    place = {p.key: i for i, p in enumerate(mission.parameters)}
    for one in pilot_units(mission.platform):
        i = place.get(one.parameter)
        if i is None or last.std[i] >= UNDETERMINED:
            continue
        p, steps = mission.parameters[i], float(last.mean[i])
        moved = p.moved(mission.platform, steps) - p.value(mission.platform)
        std = float(last.std[i]) * abs(p.slope(mission.platform, steps))
        yield Trim(
            parameter=p.key,
            quantity=one.quantity,
            unit=one.unit,
            difference=one.scale * moved,
            difference_std=abs(one.scale) * std,
            steps=steps,
        )
