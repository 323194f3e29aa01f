"""One profile smoothed: problem posed, noise estimated from a segment, passes made, results thinned to the records."""

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.filter import FilterEstimate
from gliderhpc.estimation.preparation import PreparedProfile, controls_of
from gliderhpc.estimation.settings import EstimationSettings, SmootherSettings, smoother_passes, smoother_prior
from gliderhpc.estimation.smoother.iterate import SmoothedEstimate, smooth_dive
from gliderhpc.estimation.smoother.noise import HeavyTails, NoiseModel, NoiseScale
from gliderhpc.estimation.smoother.problem import Trajectory, pose_dive, starting_trajectory
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.smoother_memory import Dive
from gliderhpc.observations.resample import ProfileSeries
from gliderhpc.outcomes import Outcome
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]

_SEGMENT = (0.15, 0.4)
"""Part of a dive from which its noise is first estimated: steady descent as a rule, settled after the surface."""


def smooth_profile(
    glider: Glider,
    series: ProfileSeries,
    vibrating: NDArray[np.bool_],
    estimate: FilterEstimate,
    prior: str,
    settings: EstimationSettings,
) -> SmoothedEstimate:
    """Smooth one profile that was filtered.

    Parameters
    ----------
    glider, series : Glider, ProfileSeries
        The hull and the record on the steps.
    vibrating : (n+1,)
        The vibration set.
    estimate, prior : FilterEstimate, str
        The filter's estimate, and the name of the disturbance prior that it took (`candidate_priors`).
    settings : EstimationSettings
        Uses ``step``, ``filter`` and ``smoother``.
    """
    bodies = glider.bodies(controls_of(glider.platform, series))
    believed = smoother_prior(glider.platform, prior)
    dive, scale = pose_dive(glider, series, bodies, vibrating, estimate, believed, settings)
    models: list[NoiseModel] = [scale] if settings.smoother.adaptive else []
    if settings.smoother.degrees_of_freedom is not None:
        models.append(_tails(dive, series, settings.smoother.degrees_of_freedom, settings.smoother))
    passes = smoother_passes(glider.platform, settings.smoother)
    capped, start = settings.smoother.model_copy(update={"max_passes": passes}), starting_trajectory(estimate)
    if settings.smoother.adaptive and passes > 1:
        dive.noise[:] = noise_from_segment(glider.hull, dive, start, scale, capped, settings.filter.gate)
    smoothed = smooth_dive(
        glider.hull, dive, start, capped, gate=settings.filter.gate, noise_models=models, usual=scale.usual
    )
    if not smoothed.outcome.usable:
        return replace(
            filter_fallback(estimate), passes=smoothed.passes, movement=smoothed.movement, outcome=smoothed.outcome
        )
    return replace(smoothed, noise_factor=scale.factors(dive.noise))


def filter_fallback(estimate: FilterEstimate) -> SmoothedEstimate:
    """Return the filter's estimate in place of a smoothed one that failed; quantities of a smoother alone are NaN."""
    states, disturbances = estimate.states, estimate.disturbances[:-1]
    return SmoothedEstimate(
        states, np.full_like(states, np.nan), disturbances, np.full_like(disturbances, np.nan),
        displacement_covariance=np.full((2, 2), np.nan), cost=np.nan, passes=0, damped=0, movement=np.nan,
        noise_factor=np.full(6, np.nan), used=0, widened=0, outcome=Outcome.DIVERGED,
    )  # fmt: skip


def noise_from_segment(
    hull: Hull, dive: Dive, start: Trajectory, scale: NoiseScale, settings: SmootherSettings, gate: float
) -> Array:
    """Estimate the variances ``(n, 6)`` of a dive's noise from a segment, before the passes over the whole dive.

    Every change of the noise costs passes; over a segment they cost a fraction. The dive's own passes renew the noise
    where it differs.
    """
    first, stop = (int(part * len(dive.noise)) for part in _SEGMENT)
    segment, rows = slice(first, stop), slice(first, stop + 1)
    part = dive._replace(
        bodies=dive.bodies[segment], noise=dive.noise[segment].copy(), fed=dive.fed[rows], measured=dive.measured[rows],
        variance=dive.variance[rows].copy(), mean_shift=np.zeros((stop - first + 1, 16)), damping=dive.damping.copy(),
        mean=np.concatenate([start.states[first, SENSED], np.zeros(6)]),
    )  # fmt: skip
    part_scale, part_start = scale.of_segment(segment), Trajectory(start.states[rows], start.disturbances[rows])
    smoothed = smooth_dive(
        hull, part, part_start, settings, gate=gate, noise_models=[part_scale], usual=part_scale.usual
    )
    noise: Array = scale.scaled(part_scale.factors(part.noise)) if smoothed.outcome.usable else dive.noise
    return noise


def _tails(dive: Dive, series: ProfileSeries, freedom: float, settings: SmootherSettings) -> HeavyTails:
    channels = tuple(list(CHANNELS).index(name) for name in settings.heavy_tailed)
    steps = max(1, round(series.sample_interval / series.step))
    return HeavyTails(dive.noise.copy(), freedom, channels, steps)


_KNOWN = (ProfileError, ArithmeticError, np.linalg.LinAlgError)
"""Errors that a record may cause in the smoother; any other is a fault of the program."""


@dataclass(frozen=True, eq=False)
class SmoothedRecords:
    """A smoothed profile on its ``m`` records; the steps in between, ten times as much, are dropped.

    Attributes
    ----------
    states, states_std : (m, 12)
        States (eq. 16, SI and rad) at the records and their standard deviations.
    disturbances, disturbances_std : (m', 6)
        Disturbance over the step that starts at each record, and its standard deviation, N and N m; m' is m, or one
        less where the profile ends with a record.
    displacement, displacement_covariance : (2,), (2, 2)
        North and east from start to end, m and m2.
    cost : float
        Of the maximum a posteriori problem; NaN where it could not be solved.
    passes : int
        Linearisations.
    noise_factor : (6,)
        Variance that the steps added in the end, over that of the prior.
    outcome : Outcome
        Where it is not usable, the values are the filter's, without standard deviations.
    trouble : str
        Error that ended the smoother early; empty as a rule.
    """

    states: Array
    states_std: Array
    disturbances: Array
    disturbances_std: Array
    displacement: Array
    displacement_covariance: Array
    cost: float
    passes: int
    noise_factor: Array
    outcome: Outcome
    trouble: str = ""


def with_smoothed(prepared: PreparedProfile, settings: EstimationSettings) -> tuple[PreparedProfile, SmoothedRecords]:
    """Smooth a profile that is ready for its windows, and let these start from the result where the settings say so.

    A profile that cannot be smoothed retains the filter's estimate and the filter's start.
    """
    began = time.perf_counter()
    problem, every = prepared.problem, settings.steps_per_record
    try:
        smoothed = _smooth(prepared, settings)
    except _KNOWN as error:
        records = replace(_thinned(filter_fallback(prepared.prior), every), trouble=str(error))
    else:
        records = _thinned(smoothed, every)
        if settings.start == "smoothed" and smoothed.outcome.usable:
            problem = replace(problem, start=smoothed.disturbances)
    return replace(prepared, problem=problem, seconds=prepared.seconds + time.perf_counter() - began), records


def _smooth(prepared: PreparedProfile, settings: EstimationSettings) -> SmoothedEstimate:
    return smooth_profile(
        prepared.glider, prepared.series, prepared.vibrating, prepared.prior, prepared.disturbance_prior, settings
    )


def _thinned(smoothed: SmoothedEstimate, every: int) -> SmoothedRecords:
    # Copies, not views, so that the steps' arrays are freed.
    states, states_std, disturbances, disturbances_std = (
        values[::every].copy()
        for values in (smoothed.states, smoothed.states_std, smoothed.disturbances, smoothed.disturbances_std)
    )
    return SmoothedRecords(
        states, states_std, disturbances, disturbances_std, smoothed.states[-1, 3:5] - smoothed.states[0, 3:5],
        smoothed.displacement_covariance, smoothed.cost, smoothed.passes, smoothed.noise_factor, smoothed.outcome,
    )  # fmt: skip
