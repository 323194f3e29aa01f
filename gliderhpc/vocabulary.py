"""Names, units, flags, tidal periods and a published formula shared by several subpackages."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal


@dataclass(frozen=True)
class Flags:
    """CF flags: values or bit masks of a variable, each with its meaning."""

    kind: Literal["flag_values", "flag_masks"]
    meanings: Mapping[str, int]

    def attributes(self) -> dict[str, Any]:
        """Return the CF attributes, with the meanings as one string."""
        return {self.kind: list(self.meanings.values()), "flag_meanings": " ".join(self.meanings)}

    def mask(self, *meanings: str) -> int:
        """Return the bits of some meanings together."""
        return sum(self.meanings[meaning] for meaning in meanings)


CHANNELS = {
    "B_cu": ("N", "disturbance force along the surge axis"),
    "B_cv": ("N", "disturbance force along the sway axis"),
    "B_cw": ("N", "disturbance force along the heave axis"),
    "B_cp": ("N m", "disturbance moment about the roll axis"),
    "B_cq": ("N m", "disturbance moment about the pitch axis"),
    "B_cr": ("N m", "disturbance moment about the yaw axis"),
}
"""The six disturbances: unit and name."""

STATES = ("roll", "pitch", "heading", "X", "Y", "depth", "u", "v", "w", "p", "q", "r")
"""The twelve states of eq. 16, by the archive's names."""

HULL_PARAMETERS = (
    "buoyancy.neutral_volume", "buoyancy.depth_slope", "viscous.K_D0", "viscous.K_D", "viscous.K_L", "position.hull.2",
    "position.battery", "position.reservoir.0", "viscous.K_M0", "viscous.K_M", "position.hull.1",
    "battery_eccentricity", "viscous.K_beta", "viscous.K_MR", "viscous.K_MY", "viscous.K_r", "viscous.K_delta",
    "buoyancy.compressibility", "buoyancy.thermal_expansion", "viscous.K_L0", "viscous.K_p", "viscous.K_q",
    "added_mass.1", "added_mass.2", "added_inertia.0", "added_inertia.1", "added_inertia.2", "sensors.roll_offset",
    "sensors.pitch_offset", "sensors.pitch_scale", "sensors.heading_offset", "sensors.heading_deviation.0",
    "sensors.heading_deviation.1", "sensors.heading_deviation.2", "sensors.heading_deviation.3", "sensors.depth_lag",
    "sensors.actuator_lag",
)  # fmt: skip
"""Keys of all parameters of a hull and its records that may be in error; the hull determines which have an effect."""

NOISE_ASSUMPTIONS = ("one scale", "quieter", "between moves")
"""Assumptions of a dive's noise other than the usual one (docs/smoother.md): one scale for the whole dive, a quieter
scale of the dive and its stretches, and only the samples between the actuators' moves."""

PHASES = ("dive", "climb")
"""Parts of a profile, before and after its deepest point."""

COMPONENTS = ("north", "east")
"""Components of a horizontal vector."""

TIDAL_PERIODS = {"M2": 12.4206012, "S2": 12.0, "K1": 23.9344721, "O1": 25.8193387}
"""Periods (h) of the tidal lines."""

QUALITY = Flags(
    "flag_masks",
    {
        "vibration": 1,
        "gap_in_the_record": 2,
        "prior_used_because_the_window_failed": 4,
        "implausible_self_motion": 8,
        "battery_rotated": 16,
        "climbing": 32,
        "window_not_converged": 64,
    },
)
"""Bits of `quality`."""

OF_WINDOWS = ("prior_used_because_the_window_failed", "window_not_converged")
"""Quality bits that concern the windows of the adjoint, and no other estimate."""


def she_leveque(order: float) -> float:
    """Return the scaling exponent zeta_p of velocity increments in intermittent turbulence (She and Leveque 1994)."""
    return order / 9.0 + 2.0 * (1.0 - math.pow(2.0 / 3.0, order / 3.0))
