"""One profile of the study: flatness and exponents with their intervals, and the surrogates' envelopes."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.studies.library.turbulence.channel import ChannelSeries
from gliderhpc.studies.library.turbulence.pieces import Pieces
from gliderhpc.studies.library.turbulence.settings import IntermittencySettings, Range
from gliderhpc.studies.library.turbulence.statistics import (
    SurrogateTest,
    fast_part,
    statistics_row,
    structure_of,
    surrogate_test,
    thinned,
)
from gliderhpc.studies.library.turbulence.structure import COVERAGE, Structure, bootstrapped, lag_samples

Array = NDArray[np.float64]
Row = dict[str, Any]


@dataclass(frozen=True, eq=False)
class ProfileIntermittency:
    """Row of the group's table, its rows on lags and on orders, and the exponents of every range of lags."""

    row: Row
    on_lags: Row
    on_orders: Row
    ranges: tuple[Row, ...] = ()


def profile_intermittency(series: ChannelSeries, settings: IntermittencySettings, seed: int) -> ProfileIntermittency:
    """Study one profile; its random numbers follow from the settings' seed and `seed`, best the profile's number."""
    part = fast_part(series, settings, actuated=False)
    row: Row = {
        "counted": float(part.pieces.counted.mean()),
        "stretches": int(part.pieces.label.max(initial=-1)) + 1,
    }
    if part.message:
        return ProfileIntermittency({**row, "message": part.message}, {}, {})
    fast = thinned(part.pieces, settings.interval)
    found = structure_of(fast, settings, series.sample_interval)
    drawn = _bootstrap(fast, settings, series.sample_interval, np.random.default_rng([settings.seed, seed, 0]))
    tested = surrogate_test(fast, settings, np.random.default_rng([settings.seed, seed, 1]))
    row |= statistics_row(part.pieces, found, series, settings)
    row |= _interval("flatness", drawn.flatness_at(settings.lag))
    row |= _interval("zeta_ratio", drawn.ratio(settings.scaling))
    row |= _surrogates_row(tested, settings, found)
    ranges = tuple(_range_row(found, drawn, scaling) for scaling in (settings.scaling, *settings.scaling_varied))
    ratios = [one["zeta_ratio"] for one in ranges]
    row |= {"zeta_ratio_least": float(np.min(ratios)), "zeta_ratio_most": float(np.max(ratios))}
    row |= _included_row(series, settings, seed)
    return ProfileIntermittency(row, _on_lags(found, drawn, tested), _on_orders(found, drawn, tested, settings), ranges)


def _bootstrap(
    fast: Pieces, settings: IntermittencySettings, sample_interval: float, rng: np.random.Generator
) -> Structure:
    lags = lag_samples(settings.every_lag, fast.step)
    drawn = bootstrapped(fast, lags, settings.block, settings.block_draws, rng)
    drawn.functions[:, drawn.lags < sample_interval - 1e-6] = np.nan
    return drawn


def _interval(name: str, draws: Array) -> Row:
    low, high = np.percentile(draws, COVERAGE)
    return {f"{name}_low": float(low), f"{name}_high": float(high)}


def _range_row(found: Structure, drawn: Structure, scaling: Range) -> Row:
    return {
        "from": scaling[0],
        "to": scaling[1],
        "zeta_ratio": float(found.ratio(scaling)),
        **_interval("zeta_ratio", drawn.ratio(scaling)),
    }


def _surrogates_row(tested: SurrogateTest, settings: IntermittencySettings, found: Structure) -> Row:
    """Rank test and envelopes; the test says nothing at a lag that the records do not resolve."""
    resolved = bool(np.isfinite(found.flatness_at(settings.lag)))
    return {
        "p_value": tested.p_value if resolved else float("nan"),
        **_envelope("flatness", tested.structures.flatness_at(settings.lag)),
        **_envelope("zeta_ratio", tested.structures.ratio(settings.scaling)),
        "surrogate_iterations": float(np.median(tested.iterations)),
        "surrogate_converged": float(tested.converged.mean()),
        "surrogate_deviation": float(np.median(tested.deviation[:, 0])),
        "surrogate_deviation_most": float(tested.deviation[:, 1].max()),
    }


def _envelope(name: str, values: Array) -> Row:
    return {f"surrogate_{name}_least": float(np.min(values)), f"surrogate_{name}_most": float(np.max(values))}


def _included_row(series: ChannelSeries, settings: IntermittencySettings, seed: int) -> Row:
    """The same statistics with the actuated samples included."""
    part = fast_part(series, settings, actuated=True)
    fast = thinned(part.pieces, settings.interval)
    found = structure_of(fast, settings, series.sample_interval)
    tested = surrogate_test(fast, settings, np.random.default_rng([settings.seed, seed, 2]))
    row = statistics_row(part.pieces, found, series, settings)
    return {f"{name}_all": value for name, value in row.items()} | {"p_value_all": tested.p_value}


def _on_lags(found: Structure, drawn: Structure, tested: SurrogateTest) -> Row:
    low, high = np.percentile(drawn.flatness, COVERAGE, axis=0)
    surrogates = tested.structures.flatness
    return {
        "lag_time": found.lags,
        "flatness_by_lag": found.flatness,
        "flatness_by_lag_low": low,
        "flatness_by_lag_high": high,
        "surrogate_flatness_by_lag_least": surrogates.min(axis=0),
        "surrogate_flatness_by_lag_most": surrogates.max(axis=0),
    }


def _on_orders(found: Structure, drawn: Structure, tested: SurrogateTest, settings: IntermittencySettings) -> Row:
    low, high = np.percentile(drawn.exponents(settings.scaling), COVERAGE, axis=0)
    surrogates = tested.structures.exponents(settings.scaling)
    return {
        "zeta": found.exponents(settings.scaling),
        "zeta_low": low,
        "zeta_high": high,
        "surrogate_zeta_least": surrogates.min(axis=0),
        "surrogate_zeta_most": surrogates.max(axis=0),
    }
