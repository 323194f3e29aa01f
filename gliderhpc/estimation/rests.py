"""Rests of a glider at one depth, as on the bottom: they are left out where the model does not follow the record.

Over a rest nothing is measured, and the ground carries the glider's weight, so that the modelled glider comes to rest
within metres and glides on from the same depth.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.filter import FilterEstimate, run_filters
from gliderhpc.estimation.preparation import PreparedProfile, fed_samples
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.glider import NET_WEIGHT
from gliderhpc.kernels.filter import GATED, RESET
from gliderhpc.observations.dive_phases import describe_levels, find_rests
from gliderhpc.observations.series import ProfileSeries

Key = TypeVar("Key")
Rest = tuple[int, int]

_MARGIN = 5.0
"""Time before and after a rest that is left out, too, s: the glider lands and leaves."""
_MIN_REJECTED = 0.5
"""Share of a rest's samples rejected by the filter above which the model does not follow the rest."""


def run_filters_around_rests(
    profiles: Sequence[tuple[Key, PreparedProfile]], settings: EstimationSettings
) -> tuple[list[tuple[Key, PreparedProfile]], list[FilterEstimate | ProfileError]]:
    """Filter profiles as `run_filters` does, without the rests that the model does not follow.

    Parameters
    ----------
    profiles : sequence of (key, PreparedProfile)
        Profiles with their keys.
    settings : EstimationSettings
        Settings of the filter.

    Returns
    -------
    profiles : list of (key, PreparedProfile)
        Profiles, without the rests that were left out.
    estimates : list of FilterEstimate or ProfileError
        Estimate of each; if it is refused without its rests as well, the error of the whole record.
    """
    used, estimates = list(profiles), run_filters([profile for _, profile in profiles], settings)
    changed = {
        i: without_rests(profile, rests)
        for i, ((_, profile), estimate) in enumerate(zip(profiles, estimates, strict=True))
        if (rests := _rests_not_followed(profile, estimate, settings))
    }
    for (i, profile), estimate in zip(changed.items(), run_filters(changed.values(), settings), strict=True):
        if isinstance(estimate, FilterEstimate):
            used[i], estimates[i] = (used[i][0], profile), estimate
    return used, estimates


def _rests_not_followed(
    profile: PreparedProfile, estimate: FilterEstimate | ProfileError, settings: EstimationSettings
) -> list[Rest]:
    """Return the rests that the model does not follow; of a refused profile all of them."""
    rests = find_rests(profile.series)
    if isinstance(estimate, ProfileError) or not rests:
        return rests
    fed, rejected = fed_samples(profile.series, settings), estimate.events & (GATED | RESET) > 0
    return [
        (begin, stop)
        for begin, stop in rests
        if (rejected & fed)[begin:stop].sum() > _MIN_REJECTED * fed[begin:stop].sum()
    ]


def without_rests(profile: PreparedProfile, rests: Sequence[Rest]) -> PreparedProfile:
    """Leave out the samples of rests, given by their rows, and let the ground carry the glider's weight there."""
    series, bodies = profile.series, profile.bodies.copy()
    margin = round(_MARGIN / series.step)
    out = np.zeros(len(series.time), dtype=bool)
    for begin, stop in rests:
        out[max(begin - margin, 0) : stop + margin] = True
        steps = slice(begin, min(stop, len(bodies)))
        bodies[steps, NET_WEIGHT] = profile.glider.hull.depth_slope * series.measurements[steps, 3]
    return replace(profile, series=_without_rows(series, out, tuple(rests)), bodies=bodies)


def _without_rows(series: ProfileSeries, out: NDArray[np.bool_], rests: tuple[Rest, ...]) -> ProfileSeries:
    partial = None if series.partial is None else series.partial[~out[series.partial[:, 0]]]
    return replace(
        series,
        weights=np.where(out, 0.0, series.weights),
        sample_index=series.sample_index[~out[series.sample_index]],
        partial=partial,
        rests=rests,
    )


def describe_rests(series: ProfileSeries) -> list[str]:
    """Remark on the rests that were left out; empty if there are none."""
    if not series.rests:
        return []
    seconds = sum(stop - begin for begin, stop in series.rests) * series.step
    levels = np.array([np.median(series.measurements[begin:stop, 3]) for begin, stop in series.rests])
    share = seconds / (series.time[-1] - series.time[0])
    at_most = "up to " if len(levels) > 1 else ""
    return [
        f"left out: {seconds:.0f} s {describe_levels(levels)}, where the glider did not glide, as on the bottom or "
        f"hovering; the current includes this time ({share:.0%}), and is {at_most}{share / (1.0 - share):.0%} stronger "
        "if the glider lay on the bottom"
    ]
