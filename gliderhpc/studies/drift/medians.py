"""Medians of every channel over a profile's steady glide within a depth band, dive and climb apart."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gliderhpc.archive.mission import open_for_job
from gliderhpc.archive.profile import ADJOINT, SMOOTHED, ProfileData, read_profile_data
from gliderhpc.platform import Platform
from gliderhpc.store_schema.studies.drift import PHASES, median_column, phase_column
from gliderhpc.studies.archived import platform_of
from gliderhpc.studies.profile_jobs import StudiedProfile
from gliderhpc.vocabulary import CHANNELS

USUAL_BAND = (150.0, 500.0)
"""Depth band of section 5.6, m."""

SHALLOW_BAND = (0.3, 0.95)
"""Band of a mission that does not reach it, in parts of the depth that nine of ten profiles reach."""

_REACHED_QUANTILE = 0.1


@dataclass(frozen=True)
class DepthBand:
    """Depths that count (m), and a remark on them."""

    low: float
    high: float
    remark: str = ""

    def holds(self, depth: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Samples inside."""
        return np.asarray((depth >= self.low) & (depth <= self.high), dtype=np.bool_)


def depth_band(max_depths: NDArray[np.float64], wanted: tuple[float, float] | None) -> DepthBand:
    """Return the band asked for, the usual one, or the corresponding part of dives too shallow for it."""
    if wanted is not None:
        return DepthBand(*wanted)
    reached = float(np.nanquantile(max_depths, _REACHED_QUANTILE))
    if reached >= USUAL_BAND[1]:
        return DepthBand(*USUAL_BAND)
    low, high = min(USUAL_BAND[0], SHALLOW_BAND[0] * reached), SHALLOW_BAND[1] * reached
    return DepthBand(
        low, high,
        f"one profile in ten is shallower than {reached:.0f} m, so the medians are taken over {low:.0f} to "
        f"{high:.0f} m in place of {USUAL_BAND[0]:.0f} to {USUAL_BAND[1]:.0f} m; --set drift.depth_band=[LOW,HIGH] "
        "chooses otherwise",
    )  # fmt: skip


Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PRIOR = "prior"
PRIMARY = (ADJOINT, SMOOTHED)
"""Estimates that count; the filter's, from which the adjoint's medians hardly differ, is shown for comparison."""

DRAG = "K_D0"
"""Name of the change of K_D0 that a disturbance is equivalent to, among the medians."""

UNITS = {name: unit for name, (unit, _) in CHANNELS.items()} | {DRAG: "kg/m"}
"""Unit of every median."""

MIN_RECORDS = 30
"""Records that a median needs."""

NOT_COUNTED = ("window_not_converged", "prior_used_because_the_window_failed", "implausible_self_motion")
"""Quality bits that a median leaves out, besides vibration, gaps and a rotated battery."""

ROTATED_SHARE = 0.5
"""Part of the steady glide with the battery rotated beyond which that is how the hull glides, and counts."""

VELOCITY = slice(2, 5)
"""Columns u, v, w of the motion."""


@dataclass(frozen=True)
class MedianJob:
    """One profile to take medians of."""

    number: int
    index: int
    archive: str
    band: DepthBand
    smoothed: bool


def profile_medians(job: MedianJob) -> StudiedProfile:
    """Take the medians of a profile; the job of a worker."""
    with threadpool_limits(limits=1), open_for_job(job.archive) as archive:
        platform, data = platform_of(archive), read_profile_data(archive, job.number, ADJOINT)
        smoothed = read_profile_data(archive, job.number, SMOOTHED) if job.smoothed else None
    return StudiedProfile(job.number, job.index, profile_row(data, smoothed, job.band, platform))


def profile_row(data: ProfileData, smoothed: ProfileData | None, band: DepthBand, platform: Platform) -> dict[str, Any]:
    """Medians of one profile.

    Parameters
    ----------
    data, smoothed : ProfileData
        With the adjoint's and, where there is one, the smoother's estimate.
    band : DepthBand
        Depths that count.
    platform : Platform
        The hull.

    Notes
    -----
    All estimates are taken over the same records, so that they can be held against each other. The change of K_D0 that
    a disturbance is equivalent to is what it takes from the motion along the path, over the squared speed:
    ``-(B . v) / |v|^3`` with the force B and the velocity v through the water (eq. 11: drag is ``V^2 (K_D0 + ...)``).
    """
    masks = {phase: counted(data, band, phase) for phase in PHASES}
    row: dict[str, Any] = {phase_column("count", phase): int(mask.sum()) for phase, mask in masks.items()}
    for phase, mask in masks.items():
        if mask.sum() < MIN_RECORDS:
            continue
        row |= _glide_row(data.motion[mask], data.reconstructed[mask], platform, phase)
        for estimate, forces, motion in _estimates(data, smoothed):
            row |= {
                median_column(name, phase, estimate): value
                for name, value in medians_of(forces[mask], motion[mask, VELOCITY]).items()
            }
    if not any(row[phase_column("count", phase)] >= MIN_RECORDS for phase in PHASES):
        row["message"] = (
            f"no {MIN_RECORDS} records of steady glide between {band.low:.0f} and {band.high:.0f} m, either way"
        )
    return row


def counted(data: ProfileData, band: DepthBand, phase: str) -> Mask:
    """Records ``(m,)`` of a phase that count: steady glide in the band, windows converged, no turn.

    A turn is a rotated battery, unless the hull mostly glides so, as some steer all the time.
    """
    climbing, turning = data.flagged("climbing"), data.flagged("battery_rotated")
    samples = data.steady & ~data.flagged(*NOT_COUNTED) & (climbing if phase == "climb" else ~climbing)
    if turning[data.steady].sum() <= ROTATED_SHARE * data.steady.sum():
        samples &= ~turning
    known = np.isfinite(data.measured).all(axis=1)
    return data.on_records(samples) & known & band.holds(data.measured[:, 3])


def medians_of(forces: Array, velocity: Array) -> dict[str, float]:
    """Medians of disturbances ``(m, 6)`` and of the change of K_D0 that they are equivalent to, by name."""
    speed = np.linalg.norm(velocity, axis=1)
    drag = -np.einsum("ni,ni->n", forces[:, :3], velocity) / speed**3
    named = zip(UNITS, [*forces.T, drag], strict=True)
    return {name: float(np.median(values[np.isfinite(values)])) for name, values in named if np.isfinite(values).any()}


def _estimates(data: ProfileData, smoothed: ProfileData | None) -> list[tuple[str, Array, Array]]:
    """Name, disturbances (m, 6) on the records and motion (m, 8) of every estimate."""
    samples = np.searchsorted(data.time, data.record_time + 0.5 * data.step, side="right") - 1
    found = [(PRIOR, data.prior[samples], data.motion), (ADJOINT, data.disturbances[samples], data.motion)]
    if smoothed is not None:
        found.append((SMOOTHED, smoothed.disturbances[samples], smoothed.motion))
    return found


def _glide_row(motion: Array, attitude: Array, platform: Platform, phase: str) -> dict[str, float]:
    """Speed, and what one newton of weight or of heave would change of the equivalent K_D0, medians over a phase.

    Notes
    -----
    Steady at the measured pitch and depth rate, drag over squared speed is ``K = W sin^3(xi) / Z'^2`` with the path's
    angle ``xi = theta - alpha``. A heave force that is not known puts alpha, and so xi, wrong by ``1 / (K_L V^2)`` a
    newton: K then by ``3 K cot(xi)``, of which the known part ``K_D alpha^2`` takes up ``2 K_D alpha``.
    """
    velocity, viscous = motion[:, VELOCITY], platform.viscous
    speed = np.linalg.norm(velocity, axis=1)
    roll, pitch = np.radians(attitude[:, :2].T)
    down = np.column_stack([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)])
    steepness = np.einsum("ni,ni->n", velocity, down) / speed
    alpha = np.arctan2(velocity[:, 2], velocity[:, 0])
    cotangent = np.sqrt(np.maximum(1.0 - steepness**2, 0.0)) / np.abs(steepness)
    drag = viscous.K_D0 + viscous.K_D * alpha**2
    by_heave = (3.0 * drag * cotangent - 2.0 * viscous.K_D * np.abs(alpha)) / (viscous.K_L * speed**2)
    return {
        phase_column("speed", phase): float(np.median(speed)),
        phase_column("weight_effect", phase): float(-np.median(steepness / speed**2)),
        phase_column("heave_effect", phase): float(np.median(by_heave)),
    }
