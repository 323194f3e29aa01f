"""One profile smoothed: its problem posed, its noise foretold by a piece of it, and the passes made."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.filter import FilterEstimate
from gliderhpc.estimation.heavy_tails import HeavyTails
from gliderhpc.estimation.noise_scale import NoiseScale
from gliderhpc.estimation.preparation import controls_of
from gliderhpc.estimation.settings import EstimationSettings, SmootherSettings, smoother_passes, smoother_prior
from gliderhpc.estimation.smoother import NoiseModel, SmoothedEstimate, smooth_dive
from gliderhpc.estimation.smoothing_problem import Path, pose_dive, starting_path
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.smoother_memory import Dive
from gliderhpc.observations.resample import ProfileSeries
from gliderhpc.outcomes import Outcome
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]

_PIECE = (0.15, 0.4)
"""Part of a dive that foretells its noise: steady descent as a rule, settled after the surface."""


def smooth_profile(
    glider: Glider,
    series: ProfileSeries,
    shaken: NDArray[np.bool_],
    estimate: FilterEstimate,
    prior: str,
    settings: EstimationSettings,
) -> SmoothedEstimate:
    """Smooth one profile that was filtered.

    Parameters
    ----------
    glider, series : Glider, ProfileSeries
        The hull and the record on the steps.
    shaken : (n+1,)
        The vibration set.
    estimate, prior : FilterEstimate, str
        The filter's estimate, and the name of the disturbance prior that it took (`candidate_priors`).
    settings : EstimationSettings
        Uses ``step``, ``filter`` and ``smoother``.
    """
    bodies = glider.bodies(controls_of(glider.platform, series))
    believed = smoother_prior(glider.platform, prior)
    dive, scale = pose_dive(glider, series, bodies, shaken, estimate, believed, settings)
    models: list[NoiseModel] = [scale] if settings.smoother.adaptive else []
    if settings.smoother.degrees_of_freedom is not None:
        models.append(_tails(dive, series, settings.smoother.degrees_of_freedom, settings.smoother))
    passes = smoother_passes(glider.platform, settings.smoother)
    capped, start = settings.smoother.model_copy(update={"max_passes": passes}), starting_path(estimate)
    if settings.smoother.adaptive and passes > 1:
        dive.noise[:] = foretold_noise(glider.hull, dive, start, scale, capped, settings.filter.gate)
    smoothed = smooth_dive(
        glider.hull, dive, start, capped, gate=settings.filter.gate, noise_models=models, usual=scale.usual
    )
    if not smoothed.outcome.usable:
        return replace(stand_in(estimate), passes=smoothed.passes, movement=smoothed.movement, outcome=smoothed.outcome)
    return replace(smoothed, noise_factor=scale.factors(dive.noise))


def stand_in(estimate: FilterEstimate) -> SmoothedEstimate:
    """The filter's estimate in place of one that could not be had; what only a smoother knows is NaN."""
    states, disturbances = estimate.states, estimate.disturbances[:-1]
    return SmoothedEstimate(
        states, np.full_like(states, np.nan), disturbances, np.full_like(disturbances, np.nan),
        displacement_covariance=np.full((2, 2), np.nan), cost=np.nan, passes=0, damped=0, movement=np.nan,
        noise_factor=np.full(6, np.nan), used=0, widened=0, outcome=Outcome.DIVERGED,
    )  # fmt: skip


def foretold_noise(
    hull: Hull, dive: Dive, start: Path, scale: NoiseScale, settings: SmootherSettings, gate: float
) -> Array:
    """Variances ``(n, 6)`` of a dive's noise by a piece of it, so that passes over all of it need not find them.

    Every change of the noise costs passes; over a piece they cost a fraction. The dive has the last word: its
    own passes renew the noise where it differs.
    """
    first, stop = (int(part * len(dive.noise)) for part in _PIECE)
    piece, rows = slice(first, stop), slice(first, stop + 1)
    part = dive._replace(
        bodies=dive.bodies[piece], noise=dive.noise[piece].copy(), fed=dive.fed[rows], measured=dive.measured[rows],
        variance=dive.variance[rows].copy(), tilt=np.zeros((stop - first + 1, 16)), hold=dive.hold.copy(),
        mean=np.concatenate([start.states[first, SENSED], np.zeros(6)]),
    )  # fmt: skip
    of_piece = scale.of_piece(piece)
    smoothed = smooth_dive(
        hull, part, Path(start.states[rows], start.disturbances[rows]), settings, gate=gate, noise_models=[of_piece],
        usual=of_piece.usual,
    )  # fmt: skip
    noise: Array = scale.scaled(of_piece.factors(part.noise)) if smoothed.outcome.usable else dive.noise
    return noise


def _tails(dive: Dive, series: ProfileSeries, freedom: float, settings: SmootherSettings) -> HeavyTails:
    channels = tuple(list(CHANNELS).index(name) for name in settings.heavy_tailed)
    steps = max(1, round(series.sample_interval / series.step))
    return HeavyTails(dive.noise.copy(), freedom, channels, steps)
