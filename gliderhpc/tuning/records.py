"""Which records a disturbance prior is tuned on: some profiles spread over the mission, long ones cut."""

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.filter import FilterRequest, fed_samples
from gliderhpc.estimation.preparation import check_seawater, controls_of, on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.vibration import vibration_set
from gliderhpc.flight.glider import Glider
from gliderhpc.observations import Observations, ProfileSeries
from gliderhpc.platform import Platform

log = logging.getLogger("gliderhpc.tune")


def spread_over(numbers: Sequence[int], count: int) -> list[int]:
    """Choose at most ``count`` of the numbers, evenly spread, the first and the last among them."""
    places = np.unique(np.linspace(0, len(numbers) - 1, min(count, len(numbers))).round().astype(int))
    return [numbers[place] for place in places]


def tuning_requests(
    observations: Observations, platform: Platform, numbers: Sequence[int], longest: float, settings: EstimationSettings
) -> list[FilterRequest]:
    """Read the profiles that a prior is tuned on; one that cannot be used is left out with a warning in the log.

    Parameters
    ----------
    observations, platform, settings : Observations, Platform, EstimationSettings
        The open file, the hull, and how records are brought onto the steps.
    numbers : sequence of int
        Profiles to read.
    longest : float
        Seconds from its start that a profile is used for.

    Raises
    ------
    InputError
        No profile can be used, or density is asked for with a hull that states no compressibility.
    """
    check_seawater(platform, settings)
    requests, reason = [], "it holds no profile"
    for number in numbers:
        try:
            requests.append(_request(observations, platform, number, longest, settings))
        except ProfileError as error:
            reason = str(error)
            log.warning("profile %d is left out: %s", number, reason)
    if not requests:
        raise InputError(f"{observations.path}: no profile to tune on can be used; {reason}")
    return requests


def _request(
    observations: Observations, platform: Platform, number: int, longest: float, settings: EstimationSettings
) -> FilterRequest:
    series = _cut(on_steps(observations.profile(number), settings), longest)
    shaken, glider = vibration_set(platform, series), Glider(platform)
    if not (fed_samples(series, settings) & ~shaken).any():
        raise ProfileError(f"profile {number}: no sample outside the vibration set is left to filter")
    return FilterRequest(glider, series, glider.bodies(controls_of(platform, series)), shaken)


def _cut(series: ProfileSeries, longest: float) -> ProfileSeries:
    n = min(len(series.controls), max(1, round(longest / series.step)))
    return replace(
        series, time=series.time[: n + 1], measurements=series.measurements[: n + 1], weights=series.weights[: n + 1],
        controls=series.controls[:n], seawater=None if series.seawater is None else series.seawater[:n],
        sample_index=series.sample_index[series.sample_index <= n],
        gap_seconds=float(np.count_nonzero(series.weights[: n + 1] == 0.0)) * series.step,
    )  # fmt: skip
