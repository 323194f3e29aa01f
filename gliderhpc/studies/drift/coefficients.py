"""The Monte-Carlo of the hull's coefficients: steady segments inverted anew with hulls that are drawn (Table 6).

Every draw goes through the filter and the windows, as the mission did, several segments side by side in the lanes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gliderhpc.archive.opening import open_for_job
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.estimation.preparation import ProfileTask
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profiles
from gliderhpc.flight.coefficients import with_errors
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import ProfileSeries
from gliderhpc.platform import Platform
from gliderhpc.studies.archived import platform_of, settings_of
from gliderhpc.studies.drift.depth_band import DepthBand
from gliderhpc.studies.drift.medians import PHASES, UNITS, medians_of
from gliderhpc.studies.drift.segments import segment_series, segments_by_phase
from gliderhpc.studies.drift.settings import CoefficientSettings

Array = NDArray[np.float64]

NOMINAL, PITCHED_UP, PITCHED_DOWN = "nominal", "pitch up", "pitch down"
OWN = (NOMINAL, PITCHED_UP, PITCHED_DOWN)
"""What is inverted with the archive's own hull: the records as they are, and with a constant error of the pitch."""

_PITCH = 1
_BODY_VELOCITY = slice(6, 9)


@dataclass(frozen=True)
class SegmentJob:
    """One profile whose segments are inverted anew."""

    number: int
    archive: str
    band: DepthBand
    settings: CoefficientSettings
    seed: int


@dataclass(frozen=True, eq=False)
class SegmentMedians:
    """What the segments of a profile give.

    Attributes
    ----------
    number : int
        Number of the profile.
    medians : (variants, phases, quantities) array
        Medians by `UNITS` of `OWN`, then of every drawn hull; NaN where a phase has no segment or no estimate.
    segments : int
        That were inverted.
    """

    number: int
    medians: Array
    segments: int


def reinvert(job: SegmentJob) -> SegmentMedians:
    """Invert a profile's segments with its own hull and with every drawn one; the job of a worker."""
    with threadpool_limits(limits=1), open_for_job(job.archive) as archive:
        platform, settings = platform_of(archive), settings_of(archive)
        data = read_profile_data(archive, job.number)
        chosen = segments_by_phase(data, job.band, job.settings.length, job.settings.segments)
        pieces = {
            phase: [segment_series(data, platform, one, settings.step) for one in own] for phase, own in chosen.items()
        }
        hulls = drawn_hulls(platform, job.settings.error, job.settings.draws, job.seed)
        medians = _medians(pieces, platform, hulls, job.settings, settings)
    return SegmentMedians(job.number, medians, sum(map(len, pieces.values())))


@lru_cache(maxsize=2)
def drawn_hulls(platform: Platform, error: float, draws: int, seed: int) -> tuple[Platform, ...]:
    """Draw hulls whose every viscous and added-mass coefficient is off by up to `error`, and that glide stably."""
    return tuple(with_errors(platform, error, seed + draw) for draw in range(draws))


def _medians(
    pieces: dict[str, list[ProfileSeries]],
    platform: Platform,
    hulls: Sequence[Platform],
    chosen: CoefficientSettings,
    settings: MissionSettings,
) -> Array:
    """Medians over the segments of each phase, of every variant."""
    found: dict[tuple[int, int], list[dict[str, float]]] = {}
    tasks = _tasks(pieces, platform, hulls, np.radians(chosen.pitch_offset))
    estimation = settings.model_copy(update={"start": "prior", "engine": "lanes"})
    for key, estimate in estimate_profiles(tasks, estimation):
        if isinstance(estimate, ProfileEstimate):
            found.setdefault(key, []).append(_of_segment(estimate, chosen.settling))
    medians = np.full((len(OWN) + len(hulls), len(PHASES), len(UNITS)), np.nan)
    for (variant, phase), rows in found.items():
        medians[variant, phase] = np.median([[row.get(name, np.nan) for name in UNITS] for row in rows], axis=0)
    return medians


def _tasks(
    pieces: dict[str, list[ProfileSeries]], platform: Platform, hulls: Sequence[Platform], offset: float
) -> Iterator[tuple[tuple[int, int], ProfileTask]]:
    """Every variant of every segment, keyed by variant and phase."""
    own = Glider(platform)
    drawn = [Glider(hull) for hull in hulls]
    for phase, name in enumerate(PHASES):
        for series in pieces[name]:
            for variant, by in enumerate((0.0, offset, -offset)):
                yield (variant, phase), ProfileTask(own, _pitched(series, by))
            for variant, glider in enumerate(drawn, start=len(OWN)):
                yield (variant, phase), ProfileTask(glider, series)


def _pitched(series: ProfileSeries, by: float) -> ProfileSeries:
    """Return the records with a constant error of the pitch, rad."""
    measurements = series.measurements.copy()
    measurements[:, _PITCH] += by
    return replace(series, measurements=measurements)


def _of_segment(estimate: ProfileEstimate, settling: float) -> dict[str, float]:
    counted = (estimate.series.time[:-1] >= settling) & ~estimate.shaken[:-1]
    velocity = estimate.solution.states[:-1, _BODY_VELOCITY]
    return medians_of(estimate.solution.disturbances[counted], velocity[counted])
