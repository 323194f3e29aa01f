"""Settings of study ``drift``, and medians of every channel over a profile's steady glide, for dive and climb."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from gliderhpc.archive.profile import ADJOINT, SMOOTHED, ProfileData
from gliderhpc.estimation.settings import Settings
from gliderhpc.platform import Platform
from gliderhpc.store_schema.columns import median_column, phase_column
from gliderhpc.vocabulary import CHANNELS, PHASES

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

USUAL_BAND = (150.0, 500.0)
"""Depth band of section 5.6, m."""

SHALLOW_BAND = (0.3, 0.95)
"""Depth band of missions too shallow for the usual one, as fractions of the depth that nine of ten profiles reach."""

_REACHED_QUANTILE = 0.1

PRIOR = "prior"

PRIMARY = (ADJOINT, SMOOTHED)
"""Estimates that the verdict always uses."""


def counted_estimates(windows_start: str) -> tuple[str, ...]:
    """Return the estimates used for the verdict, for windows that started from the filter's path or the smoothed one.

    The adjoint's medians hardly differ from those of the estimate that its windows started from. If that is the
    filter's (``prior``), the filter adds no information; if it is the smoother's, the filter is used as well, for an
    independent comparison.
    """
    return (PRIOR, *PRIMARY) if windows_start == SMOOTHED else PRIMARY


DRAG = "K_D0"
"""Name, among the medians, of the change of K_D0 that is equivalent to a disturbance."""

UNITS = {name: unit for name, (unit, _) in CHANNELS.items()} | {DRAG: "kg/m"}
"""Unit of every median."""

MIN_RECORDS = 30
"""Minimum number of records for a median."""

NOT_COUNTED = ("window_not_converged", "prior_used_because_the_window_failed", "implausible_self_motion")
"""Quality bits of samples that medians exclude, in addition to vibration, gaps and a rotated battery."""

ROTATED_SHARE = 0.5
"""Share of the steady glide with the battery rotated, above which rotation is the hull's usual state and included."""

VELOCITY = slice(2, 5)
"""Columns u, v, w of the motion."""


class CoefficientSettings(Settings):
    """Settings of the Monte Carlo of the hull's coefficients: draws, and segments that are inverted again."""

    error: float = Field(0.15, ge=0, lt=1, description="relative error of every viscous and added-mass coefficient")
    draws: int = Field(300, ge=0, description="hulls drawn; 0 for none")
    segments: int = Field(1, ge=1, description="steady segments per profile and phase")
    length: float = Field(240.0, gt=0, description="length of a segment, s")
    settling: float = Field(120.0, ge=0, description="start of a segment that is not counted, s")
    pitch_offset: float = Field(1.0, gt=0, le=10, description="constant error of the pitch that is tested, degree")

    @model_validator(mode="after")
    def _longer_than_settling(self) -> Self:
        if self.settling >= self.length:
            raise ValueError(f"a segment of {self.length:g} s must be longer than its settling of {self.settling:g} s")
        return self


class ChangeSettings(Settings):
    """Settings of the search for steps, ramps and episodes."""

    level: float = Field(
        0.02,
        gt=0,
        lt=1,
        description="probability of chance below which a change counts, half of it for the drag and half for the "
        "moments; rates in docs/drift.md",
    )
    resamples: int = Field(400, ge=100, description="null series of the bootstrap")
    smallest: float = Field(0.05, ge=0, description="smallest relative change of K_D0 that is named")
    smallest_tilt: float = Field(
        0.25, ge=0, description="smallest change of a moment that is named, in degrees of tilt that it causes"
    )
    most: int = Field(4, ge=0, description="largest number of changes; 0 for no search")


class DriftSettings(Settings):
    """Settings of the medians, the tests of their trends, and the verdict (section 5.6, docs/drift.md)."""

    depth_band: tuple[float, float] | None = Field(
        None, description="depths used, m; default 150 to 500, or the corresponding part of shallower dives"
    )
    epochs: int | None = Field(
        11, ge=3, description="number of epochs, evenly spread over the mission; null: all profiles"
    )
    epoch_size: int = Field(3, ge=2, description="consecutive profiles per epoch")
    resamples: int = Field(2000, ge=200, description="number of bootstrap samples")
    seed: int = Field(0, ge=0, description="seed of bootstraps and draws")
    drag_increase: float = Field(0.5, gt=0, description="relative increase of K_D0 for which the day is predicted")
    coefficients: CoefficientSettings = CoefficientSettings()
    changes: ChangeSettings = ChangeSettings()

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if self.depth_band is not None and not 0.0 <= self.depth_band[0] < self.depth_band[1]:
            raise ValueError("a depth_band is two depths, the shallower one first")
        return self


@dataclass(frozen=True)
class DepthBand:
    """Depths that are used (m), and a remark on them."""

    low: float
    high: float
    remark: str = ""

    def contains(self, depth: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Mask of the depths inside the band."""
        return np.asarray((depth >= self.low) & (depth <= self.high), dtype=np.bool_)


def depth_band(max_depths: NDArray[np.float64], wanted: tuple[float, float] | None) -> DepthBand:
    """Return the requested band, by default the usual one, or a corresponding one for dives too shallow for it."""
    if wanted is not None:
        return DepthBand(*wanted)
    reached = float(np.nanquantile(max_depths, _REACHED_QUANTILE))
    if reached >= USUAL_BAND[1]:
        return DepthBand(*USUAL_BAND)
    low, high = min(USUAL_BAND[0], SHALLOW_BAND[0] * reached), SHALLOW_BAND[1] * reached
    return DepthBand(
        low,
        high,
        f"one profile in ten is shallower than {reached:.0f} m, so the medians are taken over {low:.0f} to {high:.0f} "
        f"m instead of {USUAL_BAND[0]:.0f} to {USUAL_BAND[1]:.0f} m; `drift.depth_band=[LOW,HIGH]` changes this",
    )


def profile_row(data: ProfileData, smoothed: ProfileData | None, band: DepthBand, platform: Platform) -> dict[str, Any]:
    """Compute the medians of one profile.

    Parameters
    ----------
    data, smoothed : ProfileData
        Profile with the adjoint's estimate and, if there is one, with the smoother's.
    band : DepthBand
        Depths that are used.
    platform : Platform
        The hull.

    Notes
    -----
    All estimates are evaluated on the same records, which makes them comparable. The equivalent change of K_D0 is the
    component of a disturbance against the motion, over the squared speed: ``-(B . v) / |v|^3`` with the force B and the
    velocity v through the water (eq. 11: drag is ``V^2 (K_D0 + ...)``).
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
            f"fewer than {MIN_RECORDS} records of steady glide between {band.low:.0f} and {band.high:.0f} m, on dive "
            "and on climb"
        )
    return row


def counted(data: ProfileData, band: DepthBand, phase: str) -> Mask:
    """Mask ``(m,)`` of the records used in a phase: steady glide in the band, windows converged, no turn.

    Records with a rotated battery are turns, unless the battery is rotated in most of the steady glide, as on hulls
    that steer all the time.
    """
    climbing, turning = data.flagged("climbing"), data.flagged("battery_rotated")
    samples = data.steady & ~data.flagged(*NOT_COUNTED) & (climbing if phase == "climb" else ~climbing)
    if turning[data.steady].sum() <= ROTATED_SHARE * data.steady.sum():
        samples &= ~turning
    known = np.isfinite(data.measured).all(axis=1)
    return data.on_records(samples) & known & band.contains(data.measured[:, 3])


def medians_of(forces: Array, velocity: Array) -> dict[str, float]:
    """Medians of disturbances ``(m, 6)`` and of the equivalent change of K_D0, by name."""
    speed = np.linalg.norm(velocity, axis=1)
    drag = -np.einsum("ni,ni->n", forces[:, :3], velocity) / speed**3
    named = zip(UNITS, [*forces.T, drag], strict=True)
    return {name: float(np.median(values[np.isfinite(values)])) for name, values in named if np.isfinite(values).any()}


def _estimates(data: ProfileData, smoothed: ProfileData | None) -> list[tuple[str, Array, Array]]:
    """Name, disturbances (m, 6) on the records and motion (m, 8) of every estimate."""
    samples = np.searchsorted(data.time, data.record_time + 0.5 * data.step, side="right") - 1
    estimates = [(PRIOR, data.prior[samples], data.motion), (ADJOINT, data.disturbances[samples], data.motion)]
    if smoothed is not None:
        estimates.append((SMOOTHED, smoothed.disturbances[samples], smoothed.motion))
    return estimates


def _glide_row(motion: Array, attitude: Array, platform: Platform, phase: str) -> dict[str, float]:
    """Speed, and change of the equivalent K_D0 per newton of weight or of heave force, medians over a phase.

    Notes
    -----
    In a steady glide at the measured pitch and depth rate, drag over squared speed is ``K = W sin^3(xi) / Z'^2`` with
    the path's angle ``xi = theta - alpha``. An unknown heave force changes alpha, and hence xi, by ``1 / (K_L V^2)``
    per newton. This changes K by ``3 K cot(xi)`` per radian, of which the known part ``K_D alpha^2`` accounts for
    ``2 K_D alpha``.
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
