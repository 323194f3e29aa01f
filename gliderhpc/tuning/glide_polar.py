"""Drag over lift of a hull that nobody has measured, from the response of the depth rate to the pitch.

Pitch and depth rate give the speed through the water once the angle of attack is known, and the angle of attack depends
on the ratio of drag to lift alone. A vehicle of the same make gives the prior of this ratio. Within one dive or climb
the net buoyancy changes slowly, with depth; so quicker changes of pitch show how the depth rate responds to it.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.self_motion import angle_of_attack
from gliderhpc.flight.steady_glide import drag_and_lift
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.platform import Platform, read_platform
from gliderhpc.tuning.least_squares import biweights

Array = NDArray[np.float64]

PRIOR_DEVIATION = 0.35
"""Standard deviation of the logarithm of drag over lift of one vehicle about its make: fouling, sensors and wings."""

UNKNOWN_DEVIATION = 0.5
"""The same where the make of the vehicle is not known."""

UNFOLLOWED_PITCH = np.radians(0.5)
"""Changes of the pitch (rad) between segments that the depth rate does not follow: by water and sensor."""

SEGMENT = 60.0
"""Length of the averages (s), at least three samples."""

MIN_SEGMENTS = 6
"""Segments that a dive or a climb needs, for its buoyancy is fitted with two numbers."""

MIN_PITCH = np.radians(8.0)
"""Flatter flight is no steady glide."""

MIN_RATE = 0.02
"""Slower vertical motion (m/s) is none either."""

_MAKES = (
    ("slocum", r"slocum|teledyne|webb|\bunit[_ ]?\d+|\bru\d\d\b|dbdreader"),
    ("seaglider", r"seaglider|kongsberg|hydroid|\bsg\d{3}\b"),
    ("seaexplorer", r"seaexplorer|alseamar|\bsea\d{3}\b|\beva\d{3}\b"),
    ("petrel-l", r"petrel"),
    ("seawing", r"sea[- ]?wing|haiyi"),
)
_FALLBACK = "slocum"
MIN_PHASES = 4
"""Dives and climbs that the scatter is judged by."""

_PASSES = 6
_STEP = 0.05
_MIN_SCALE = 1e-4
_REACH = 1.0


@dataclass(frozen=True, eq=False)
class GlidePolar:
    """Drag and lift by which pitch and depth rate give the speed.

    Attributes
    ----------
    platform : Platform
        A shipped hull of the make with its drag scaled, or the hull given; nothing but its drag and lift is used.
    deviation : float
        Standard deviation of the logarithm of drag over lift.
    scaled : float
        Factor on the drag of the shipped hull; 1 for a hull given.
    segments : int
        Averages of steady flight that the fit rests on; 0 without a fit.
    make : str
        The shipped hull that is the prior, or the hull given.
    """

    platform: Platform
    deviation: float
    scaled: float
    segments: int
    make: str

    def moved(self, deviations: float) -> Platform:
        """The hull with its drag so many standard deviations away."""
        return with_drag(self.platform, float(np.exp(deviations * self.deviation)))


def with_drag(platform: Platform, factor: float) -> Platform:
    """Return a hull with another drag at the same lift."""
    viscous = platform.viscous
    scaled = viscous.model_copy(update={"K_D0": viscous.K_D0 * factor, "K_D": viscous.K_D * factor})
    return platform.model_copy(update={"viscous": scaled})


def prior_polar(vehicle: str) -> GlidePolar:
    """Drag and lift of a vehicle's make, from what a file says about its glider."""
    make = next((make for make, pattern in _MAKES if re.search(pattern, vehicle.lower())), None)
    deviation = UNKNOWN_DEVIATION if make is None else PRIOR_DEVIATION
    return GlidePolar(read_platform(make or _FALLBACK), deviation, 1.0, 0, make or f"unknown, as {_FALLBACK}")


@dataclass(frozen=True, eq=False)
class GlideSegments:
    """Averages over steady flight, ``(n,)`` each: which dive or climb, depth (m), pitch (rad), depth rate (m/s)."""

    phase: NDArray[np.int64]
    depth: Array
    pitch: Array
    rate: Array


def glide_segments(records: Iterable[ProfileRecord]) -> GlideSegments:
    """Average the steady flight of some profiles."""
    rows: list[tuple[int, float, float, float]] = []
    for place, record in enumerate(records):
        rows += [(2 * place + int(rate < 0.0), depth, pitch, rate) for depth, pitch, rate in _segments(record)]
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    return GlideSegments(table[:, 0].astype(np.int64), table[:, 1], table[:, 2], table[:, 3])


def _segments(record: ProfileRecord) -> list[tuple[float, float, float]]:
    """Depth, pitch and depth rate of a profile's segments."""
    known = np.flatnonzero(np.isfinite(record.depth) & np.isfinite(record.pitch))
    if len(known) < 4:
        return []
    time, depth, pitch = record.time[known], record.depth[known], record.pitch[known]
    length = max(SEGMENT, 3.0 * float(np.median(np.diff(time))))
    found = []
    edges = np.searchsorted(time, np.arange(time[0], time[-1], length))
    for start, stop in pairwise(edges.tolist()):
        if stop - start < 3 or time[stop] - time[start] > 1.5 * length:
            continue
        rate = float((depth[stop] - depth[start]) / (time[stop] - time[start]))
        angles = pitch[start : stop + 1]
        gliding = np.all(np.abs(angles) > MIN_PITCH) and np.all(angles * rate < 0.0) and abs(rate) > MIN_RATE
        if gliding and float(np.std(angles)) < np.radians(3.0):
            found.append((float(depth[start : stop + 1].mean()), float(angles.mean()), rate))
    return found


def fit_polar(prior: GlidePolar, segments: GlideSegments) -> GlidePolar:
    """Fit drag over lift to the response of the depth rate to the pitch.

    Notes
    -----
    The balance along the path, ``(K_D0 + K_D alpha^2) V^2 = B sin(xi)`` with net buoyancy B and glide angle xi, gives
    ``2 ln |v_z| = ln B + 3 ln |sin(xi)| - ln(K_D0 + K_D alpha^2)``. In each dive and climb ln B is a line in depth,
    which is projected out of observations and model; what is left determines the logarithm of drag over lift, with the
    prior of the make. Segments are weighted by Tukey's biweight, and the error is by the scatter from dive to dive.
    A change of pitch that is not the glide's own (the water's, the sensor's) makes the response too weak; what that may
    do is in the error, so that the fit counts where the pilot has changed the pitch, and hardly where not.
    """
    phases = [rows for rows in _phases(segments) if len(rows) >= MIN_SEGMENTS]
    moved, own, count = 0.0, np.inf, 0
    for _ in range(_PASSES):
        parts = [part for rows in phases if (part := _projected(prior, segments, rows, moved)) is not None]
        if len(parts) < MIN_PHASES:
            return prior
        step, own, count = _step(parts)
        moved = float(np.clip((moved + step) / (1.0 + own / prior.deviation**2), -_REACH, _REACH))
    deviation = float((prior.deviation**-2.0 + 1.0 / own) ** -0.5)
    return GlidePolar(prior.moved(moved / prior.deviation), deviation, float(np.exp(moved)), count, prior.make)


def _step(parts: Sequence["_Projected"]) -> tuple[float, float, int]:
    """Least-squares step by all dives and climbs, its variance, and the number of segments."""
    left, slope, missed = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("residual", "by_drag", "unfollowed")
    )
    weights = biweights(left, _MIN_SCALE)
    owner = np.repeat(np.arange(len(parts)), [len(part.residual) for part in parts])
    score, information = (np.bincount(owner, weights * slope * column) for column in (left, slope))
    total = float(information.sum())
    step = float(score.sum()) / total
    scatter = float(np.sum((score - information * step) ** 2)) / total**2
    systematic = float(np.sum(weights * slope * missed)) / total
    return step, scatter + systematic**2, len(left)


def _phases(segments: GlideSegments) -> list[NDArray[np.int64]]:
    return [np.flatnonzero(segments.phase == number) for number in np.unique(segments.phase)]


@dataclass(frozen=True, eq=False)
class _Projected:
    """One dive or climb, less a line in depth, ``(n,)`` each.

    Residuals of the logarithm of the depth rate, their derivative by the logarithm of drag over lift, and what the
    residuals would be off by if a part of the pitch's changes were not the glide's (`UNFOLLOWED_PITCH`).
    """

    residual: Array
    by_drag: Array
    unfollowed: Array


def _projected(prior: GlidePolar, segments: GlideSegments, rows: NDArray[np.int64], moved: float) -> _Projected | None:
    pitch, rate, depth = segments.pitch[rows], segments.rate[rows], segments.depth[rows]
    here, ahead, behind = (_expected(prior, pitch, moved + step) for step in (0.0, _STEP, -_STEP))
    known = np.isfinite(here + ahead + behind)
    if np.count_nonzero(known) < MIN_SEGMENTS:
        return None
    line = np.column_stack([np.ones(len(depth)), depth - depth.mean()])[known]
    columns = np.column_stack([np.log(np.abs(rate)) - here, (ahead - behind) / (2.0 * _STEP), here, pitch])[known]
    residual, by_drag, response, change = (columns - line @ np.linalg.lstsq(line, columns, rcond=None)[0]).T
    spread = float(np.mean(change**2))
    if spread < UNFOLLOWED_PITCH**2:
        return None
    share = UNFOLLOWED_PITCH**2 / (spread + UNFOLLOWED_PITCH**2)
    return _Projected(residual, by_drag, share * response)


def _expected(prior: GlidePolar, pitch: Array, moved: float) -> Array:
    """Logarithm of the depth rate but for the buoyancy; NaN for paths flatter than the hull can glide."""
    platform = with_drag(prior.platform, float(np.exp(moved)))
    alpha = angle_of_attack(platform, pitch)
    drag, _ = drag_and_lift(platform, alpha)
    return np.asarray(1.5 * np.log(np.abs(np.sin(pitch - alpha))) - 0.5 * np.log(drag))
