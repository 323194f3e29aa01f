"""Detection of known yaw impulses in the identified moment: height and delay, false alarms, quiet samples."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.simulator import Impulse
from gliderhpc.studies.library.turbulence.series import bridged, high_passed
from gliderhpc.twins.inversion import TwinInversion
from gliderhpc.twins.scoring import YAW

Array = NDArray[np.float64]

ISOLATION = 8.0
"""Smallest distance of an isolated impulse, s (or `ISOLATION_WIDTHS` widths), from others and from unsteady glide."""

ISOLATION_WIDTHS = 4.0
SEARCH = 2.0
"""Seconds, or one width if longer, around the true time in which a peak is searched."""

QUIET_DISTANCE = 12.0
"""Seconds, or six widths if longer: beyond this distance from every impulse a peak is a false alarm."""


@dataclass(frozen=True)
class Finding:
    """One true impulse and the highest peak of its sign near it.

    Attributes
    ----------
    amplitude : float
        True peak with its sign, N m.
    width : float
        Standard deviation, s.
    peak : float
        Identified, high-passed, counted positive in the direction of the true one, N m.
    delay : float
        Delay of the identified peak, s.
    gain : float
        Identified over true, both high-passed, at the peak of each.
    """

    amplitude: float
    width: float
    peak: float
    delay: float
    gain: float


def find_impulses(inversion: TwinInversion, moment: Array | None = None) -> list[Finding]:
    """Search for every isolated impulse of steady glide in the high-passed identified yaw moment.

    The high-pass removes the slow part from estimate and truth alike, so that the threshold applies to the impulse.

    Parameters
    ----------
    inversion : TwinInversion
        The twin.
    moment : (n,) array, optional
        Yaw moment of another estimator, N m; the adjoint's where None.
    """
    estimate, truth = high_passed_moments(inversion, moment)
    time = inversion.estimate.series.time[:-1]
    impulses = inversion.profile_truth.impulses
    return [
        _finding(impulse, estimate, truth, time)
        for index, impulse in enumerate(impulses)
        if _is_isolated(index, impulses, time, inversion.steady)
    ]


def high_passed_moments(inversion: TwinInversion, moment: Array | None = None) -> tuple[Array, Array]:
    """High-passed yaw moment, identified (the adjoint's where None) and true ``(n,)``, N m, unsteady glide bridged."""
    identified = inversion.estimate.solution.disturbances[:, YAW] if moment is None else moment
    return (
        high_passed(bridged(identified, inversion.steady), inversion.step),
        high_passed(bridged(inversion.truth[:, YAW], inversion.steady), inversion.step),
    )


def quiet_peaks(inversion: TwinInversion, spacing: float) -> Array:
    """Largest size of the high-passed identified moment in every quiet block of `spacing` s: candidate false alarms."""
    estimate, _ = high_passed_moments(inversion)
    quiet = quiet_samples(inversion)
    count = round(spacing / inversion.step)
    blocks = len(estimate) // count
    sizes = np.abs(estimate[: blocks * count]).reshape(blocks, count)
    return np.asarray(sizes[quiet[: blocks * count].reshape(blocks, count).all(axis=1)].max(axis=1))


def quiet_samples(inversion: TwinInversion) -> NDArray[np.bool_]:
    """Steps ``(n,)`` of steady glide away from every impulse."""
    time, quiet = inversion.estimate.series.time[:-1], inversion.steady.copy()
    for impulse in inversion.profile_truth.impulses:
        quiet &= np.abs(time - impulse.time) > max(QUIET_DISTANCE, 6.0 * impulse.width)
    return quiet


def _is_isolated(index: int, impulses: tuple[Impulse, ...], time: Array, steady: NDArray[np.bool_]) -> bool:
    impulse = impulses[index]
    reach = max(ISOLATION, ISOLATION_WIDTHS * impulse.width)
    others = impulses[:index] + impulses[index + 1 :]
    if any(abs(other.time - impulse.time) < reach + ISOLATION_WIDTHS * other.width for other in others):
        return False
    if impulse.time - reach < time[0] or impulse.time + reach > time[-1]:
        return False
    return bool(steady[np.abs(time - impulse.time) <= reach].all())


def _finding(impulse: Impulse, estimate: Array, truth: Array, time: Array) -> Finding:
    near = np.flatnonzero(np.abs(time - impulse.time) <= max(SEARCH, impulse.width))
    sign = 1.0 if impulse.amplitude > 0.0 else -1.0
    best = near[int(np.argmax(sign * estimate[near]))]
    true = float((sign * truth[near]).max())
    peak = float(sign * estimate[best])
    # Steps hold the mean over their length, so their time is their middle.
    step = float(time[1] - time[0])
    return Finding(impulse.amplitude, impulse.width, peak, float(time[best]) + 0.5 * step - impulse.time, peak / true)
