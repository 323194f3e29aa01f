"""What differs between a twin and what its records and its platform file say of it: offsets, trim, coefficients."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.platform import Platform
from gliderhpc.simulator import Scenario
from gliderhpc.twins.inversion import TwinCase
from gliderhpc.twins.worlds import course_of

_STREAM = 4_000
_OFFSETS = ("roll_offset", "pitch_offset", "heading_offset")


@dataclass(frozen=True)
class Spreads:
    """How far a twin may be from what is believed of it; the coverage found depends on them.

    Attributes
    ----------
    coefficients : float
        Every viscous and added-mass coefficient is uniform within this share, independently.
    roll_offset, pitch_offset, heading_offset : float
        Standard deviations of constant errors of the attitude sensor, degree.
    neutral_volume : float
        Standard deviation of the neutral volume's error, cm3.
    battery_position : float
        Standard deviation of the error of the battery's zero, m.
    fix_error : float
        Standard deviation of a fix, north and east each, m.
    """

    coefficients: float = 0.15
    roll_offset: float = 0.5
    pitch_offset: float = 0.5
    heading_offset: float = 2.0
    neutral_volume: float = 30.0
    battery_position: float = 0.0005
    fix_error: float = 5.0


def drawn_case(
    platform: Platform, scenario: Scenario, spreads: Spreads, settings: EstimationSettings, seed: int
) -> TwinCase:
    """Draw a twin of a world: the hull that flies and its sensors are off, the estimator believes the platform file.

    Its course is uniform; current, shear, gusts and the fixes' errors are drawn from the seed by the simulator.
    """
    rng = np.random.default_rng([seed, _STREAM])
    offsets = {name: float(rng.normal(0.0, getattr(spreads, name))) for name in _OFFSETS}
    flies = _with_trim(
        platform,
        neutral_volume=float(rng.normal(0.0, spreads.neutral_volume)),
        battery=float(rng.normal(0.0, spreads.battery_position)),
    )
    sensors = {**scenario.sensors.model_dump(), **offsets, "fix_deviation": spreads.fix_error}
    steering = {**scenario.steering.model_dump(), "courses": (float(rng.uniform(0.0, 360.0)),), "waypoints": ()}
    drawn = scenario.replaced(
        {"sensors": sensors, "coefficients": {"spread": spreads.coefficients}, "steering": steering}
    )
    return TwinCase(flies, drawn, seed, settings, course_of(seed), assumed=platform)


def offsets_of(case: TwinCase) -> dict[str, Any]:
    """Say what was drawn of a case: offsets (degree), neutral volume (cm3) and battery zero (m) over those believed."""
    believed = case.assumed or case.hull
    return {
        **{name: getattr(case.scenario.sensors, name) for name in _OFFSETS},
        "neutral_volume_error": case.hull.buoyancy.neutral_volume - believed.buoyancy.neutral_volume,
        "battery_position_error": case.hull.position.battery - believed.position.battery,
    }


def _with_trim(platform: Platform, *, neutral_volume: float, battery: float) -> Platform:
    buoyancy, position = platform.buoyancy, platform.position
    return platform.model_copy(
        update={
            "buoyancy": buoyancy.model_copy(update={"neutral_volume": buoyancy.neutral_volume + neutral_volume}),
            "position": position.model_copy(update={"battery": position.battery + battery}),
        }
    )
