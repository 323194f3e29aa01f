"""The fixed-parameter forward model, driven by a profile's recorded controls, against its record (section 3).

One run a profile: from the first state (measured attitude and depth, the glide's speed) over the whole dive, without
feedback or disturbance, as the paper's Figure 1 shows it. Whatever drifts, drifts: what the mission's statistics use is
therefore pitch and depth *rate*, which do not accumulate; depth, heading and track are reported as they come out.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.archive.profile import SETTLING
from gliderhpc.errors import ProfileError
from gliderhpc.estimation.currents import local_displacement
from gliderhpc.estimation.initial_state import flight_guesses, smoothed_slope
from gliderhpc.estimation.preparation import controls_of
from gliderhpc.estimation.self_motion import SelfMotion
from gliderhpc.flight.glider import Glider
from gliderhpc.observations import ProfileRecord, ProfileSeries
from gliderhpc.studies.library.scores import rms

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

RATE_SMOOTHING = 60.0
"""Seconds (or three sample intervals, if longer) over which depth rates are taken, model's and record's alike."""
OUT_OF_THE_WATER = 0.5
"""The modelled glider is at the surface once it is this far (m) above it, and above where it began."""


@dataclass(frozen=True, eq=False)
class Flight:
    """A forward run.

    Attributes
    ----------
    states : (n+1, 12)
        Eq. 16; from `surfaced` on the glider rests where it came up.
    surfaced : int
        First sample at the surface, n + 1 where it never came up.
    """

    states: Array
    surfaced: int


def fly(glider: Glider, series: ProfileSeries) -> Flight:
    """Fly a profile open loop under its recorded controls.

    Raises
    ------
    ProfileError
        The trajectory left the model's domain.
    """
    controls = controls_of(glider.platform, series)
    state0 = flight_guesses(glider.platform, series)[0]
    states = glider.simulate(state0, controls, np.zeros((len(controls), 6)), series.step)
    up = np.flatnonzero(states[:, 5] < min(0.0, state0[5]) - OUT_OF_THE_WATER)
    surfaced = int(up[0]) if len(up) else len(states)
    if not np.isfinite(states[:surfaced]).all():
        raise ProfileError("the forward model diverged under the recorded controls: check the hull")
    # Above the water the model means nothing; a glider that came up early waits there.
    states[surfaced:] = states[max(surfaced - 1, 0)]
    return Flight(states, surfaced)


def compared_samples(flight: Flight, series: ProfileSeries, shaken: Mask) -> Mask:
    """Samples ``(n+1,)`` that the statistics count: steady glide, settled, in the record and before surfacing."""
    counted: Mask = ~shaken & (series.weights > 0.0) & (series.time - series.time[0] >= SETTLING)
    counted[flight.surfaced :] = False
    return counted


def vertical_errors(flight: Flight, series: ProfileSeries, counted: Mask) -> dict[str, float]:
    """Root mean square errors of depth (m), pitch and heading (degree), and of both longitudinal rates (1).

    Notes
    -----
    ``longitudinal_rmse = sqrt((e_theta^2 + e_w^2) / 2)`` with ``e_theta = rms(theta - theta_g) / rms(theta_g)`` and
    ``e_w = rms(Zdot - Zdot_g) / rms(Zdot_g)``: dimensionless, and blind to how long the dive was. The paper does not
    define its own.
    """
    residual = flight.states[:, [0, 1, 2, 5]] - series.measurements
    residual[:, 2] = np.arctan2(np.sin(residual[:, 2]), np.cos(residual[:, 2]))
    width = max(RATE_SMOOTHING, 3.0 * series.sample_interval)
    rates = smoothed_slope(np.column_stack([flight.states[:, 5], series.measurements[:, 3]]), series.step, width)
    pitch = rms(residual[counted, 1]) / rms(series.measurements[counted, 1])
    rate = rms(rates[counted, 0] - rates[counted, 1]) / rms(rates[counted, 1])
    return {
        "depth_rmse": rms(residual[counted, 3]),
        "pitch_rmse": float(np.degrees(rms(residual[counted, 1]))),
        "heading_rmse": float(np.degrees(rms(residual[counted, 2]))),
        "longitudinal_rmse": float(np.sqrt(0.5 * (pitch**2 + rate**2))),
    }


def horizontal_errors(
    flight: Flight, series: ProfileSeries, record: ProfileRecord, conventional: SelfMotion
) -> dict[str, float]:
    """Distances (m) at the profile's end, and over the path's length (1).

    The forward model's end is held against the glide-angle dead reckoning's (both through the water) and, where there
    are fixes, against the fix-to-fix displacement; the current is in the latter and in neither track.
    """
    track = flight.states[:, 3:5]
    reckoned = conventional.total
    path = float(np.linalg.norm(conventional.steps, axis=1).sum())
    error = float(np.linalg.norm(track[-1] - track[0] - reckoned))
    row = {
        "path_length": path,
        "horizontal_error": error,
        "horizontal_error_rate": error / path if path > 0.0 else float("nan"),
        "horizontal_error_on_course": float(np.linalg.norm(_on_recorded_course(flight, series) - reckoned)),
    }
    if record.entry_fix is not None and record.exit_fix is not None:
        moved = local_displacement(record.entry_fix, record.exit_fix)
        row["surfacing_error"] = float(np.linalg.norm(track[-1] - track[0] - moved))
        row["surfacing_error_rate"] = row["surfacing_error"] / path if path > 0.0 else float("nan")
        row["surfacing_error_glide_angle"] = float(np.linalg.norm(reckoned - moved))
    return row


def _on_recorded_course(flight: Flight, series: ProfileSeries) -> Array:
    """Displacement ``(2,)`` with the modelled speed along the compass's heading: the speed's error alone."""
    lengths = np.linalg.norm(np.diff(flight.states[:, 3:5], axis=0), axis=1)
    heading = series.measurements[:-1, 2]
    return np.array([lengths @ np.cos(heading), lengths @ np.sin(heading)])
