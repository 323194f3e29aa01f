"""One profile on a uniform grid of steps, and averages of its columns over other steps."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.records import FloatArray
from gliderhpc.wording import counted


def describe_false_samples(series: "ProfileSeries") -> list[str]:
    """Describe the isolated false samples of sensors and actuators that were left out; empty if there were none."""
    if not series.false_samples:
        return [*series.false_controls]
    return [
        *series.false_controls,
        f"{counted(series.false_samples, 'isolated false sample is', 'isolated false samples are')} left out",
    ]


@dataclass(frozen=True, eq=False)
class ProfileSeries:
    """One profile on a uniform grid of n steps (n + 1 points).

    Attributes
    ----------
    number : int
        Number of the profile.
    epoch : numpy.datetime64
        Time of the record's first sample (ns, UTC).
    step : float
        Spacing of the grid points (s).
    time : (n + 1,) array
        Seconds since `epoch`; the first is not 0 if the start of the record was unusable.
    measurements : (n + 1, 4) array
        Roll, pitch, heading (rad, heading unwrapped) and depth (m).
    weights : (n + 1,) array
        0 inside gaps of any of the four measurements, 1 elsewhere.
    controls : (n, 4) array
        Battery position (m), battery rotation (rad), ballast volume (m3), rudder (rad) at the midpoint of each step.
    sample_interval : float
        Interval between samples that hold all four measurements: the time-weighted median without gaps (s).
    gap_seconds : float
        Time with zero weight (s).
    sample_index : (m,) int array
        Grid points nearest to the samples that hold all four measurements.
    attitude_interval : float
        Interval between samples that hold roll, pitch and heading, as `sample_interval` (s); 0 if it is unknown.
    control_interval : (n,) array or None
        Time between the actuators' records before and after each step (s); None if it is the sample interval.
    false_samples : int
        Number of isolated false samples of the sensors that were left out.
    false_controls : tuple of str
        Sentences on those of the actuators that were left out.
    filled : tuple of str
        Names of the measurements whose repeated or interpolated values were left out.
    partial : (k, 2) int array or None
        Grid point and column of each measurement in samples that lack another of the four; None if there are none.
    seawater : (n, 4) array or None
        Depth (m), in-situ density (kg/m3), in-situ temperature (degC) and pressure (dbar) at the midpoint of each step;
        None if they are unknown (`gliderhpc.observations.seawater`).
    without_seawater : str
        Reason why they are unknown; empty if they are known or were not requested.
    rests : tuple of (int, int)
        First grid point, and point after the last, of each rest at one depth that was left out.
    velocity, velocity_std : (n + 1, 3) arrays or None
        Measured velocity relative to the water and its standard deviation (m/s), means over the samples nearest to each
        point, NaN elsewhere; None if the record has none.
    """

    number: int
    epoch: np.datetime64
    step: float
    time: FloatArray
    measurements: FloatArray
    weights: FloatArray
    controls: FloatArray
    sample_interval: float
    gap_seconds: float
    sample_index: npt.NDArray[np.int64]
    attitude_interval: float = 0.0
    control_interval: FloatArray | None = None
    false_samples: int = 0
    false_controls: tuple[str, ...] = ()
    filled: tuple[str, ...] = ()
    partial: npt.NDArray[np.int64] | None = None
    seawater: FloatArray | None = None
    without_seawater: str = ""
    rests: tuple[tuple[int, int], ...] = ()
    velocity: FloatArray | None = None
    velocity_std: FloatArray | None = None

    def sampled_records(self, every: int) -> npt.NDArray[np.bool_]:
        """Mask ``(n // every + 1,)`` of the records, `every` steps apart, that are nearest to samples."""
        sampled = np.zeros((len(self.time) - 1) // every + 1, dtype=np.bool_)
        nearest = np.rint(self.sample_index / every).astype(np.int64)
        sampled[nearest[nearest < len(sampled)]] = True
        return sampled


def averages_between(values: FloatArray, edges: FloatArray, wanted: FloatArray) -> FloatArray:
    """Average piecewise-constant columns over other steps, exactly.

    Parameters
    ----------
    values : (n, k) array
        Columns; row i applies from ``edges[i]`` to ``edges[i + 1]``.
    edges : (n + 1,) array
        Edges of the steps of `values`, increasing.
    wanted : (m + 1,) array
        Edges of the steps to average over, increasing; beyond `edges` the values are taken as zero.

    Returns
    -------
    (m, k) array
    """
    integral = np.vstack([np.zeros(values.shape[1]), np.cumsum(values * np.diff(edges)[:, None], axis=0)])
    at_wanted = np.column_stack([np.interp(wanted, edges, column) for column in integral.T])
    return np.asarray(np.diff(at_wanted, axis=0) / np.diff(wanted)[:, None])
