"""Study ``intermittency``: increments of a disturbance's fast part compared with surrogates (section 5.3).

A profile's results are the flatness and the scaling exponents with intervals, the rank test, and the envelopes of the
surrogates.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.archive.reader import Archive
from gliderhpc.store_schema.columns import (
    FLATNESS_BY_LAG,
    RANGE,
    RANGE_STATISTICS,
    ZETA,
    CurveColumns,
    Ends,
    actuated_column,
    interval_columns,
    range_column,
    surrogate_columns,
)
from gliderhpc.studies.library.trends import INTERVAL
from gliderhpc.studies.library.turbulence.gaussianity import noise_of, noise_rows
from gliderhpc.studies.library.turbulence.series import (
    ChannelSeries,
    IntermittencySettings,
    averaged_over,
    channel_of,
    fast_part,
    missing_band,
    series_step,
    steps_within,
)
from gliderhpc.studies.library.turbulence.statistics import (
    ORDERS,
    StructureFunctions,
    bootstrap_structure_functions,
    lag_samples,
    resolved_structure_functions,
    statistics_row,
    without_unresolved_lags,
)
from gliderhpc.studies.library.turbulence.surrogates import SurrogateTest, surrogate_test
from gliderhpc.studies.request import Request
from gliderhpc.studies.study import Preparation, ProfileContext, Row, Study

Array = NDArray[np.float64]

NAME = "intermittency"
QUICK_SURROGATES = 9


# One profile


def study_profile(data: ProfileData, context: ProfileContext) -> Row:
    """Compute statistics of one profile and its surrogates: scalars, values by range of lags, and curves.

    The curves are functions of the lag and of the order. If the record does not resolve the band at all, the row gives
    the reason and no statistics.
    """
    settings: IntermittencySettings = context.settings
    channel = channel_of(data, settings.channel, context.platform)
    part = fast_part(channel, settings, actuated=False)
    row: dict[str, Any] = {
        "nyquist": channel.nyquist,
        "counted": float(part.series.counted.mean()),
        "stretches": part.series.stretch_count,
    }
    if part.message:
        return {**row, "message": part.message}
    fast = averaged_over(part.series, settings.interval)
    measured = resolved_structure_functions(fast, settings, channel.sample_interval)
    lags, rng = lag_samples(settings.every_lag, fast.step), np.random.default_rng([settings.seed, data.number, 0])
    drawn = bootstrap_structure_functions(fast, lags, settings.block, settings.block_draws, rng)
    drawn = without_unresolved_lags(drawn, channel.sample_interval)
    rng = np.random.default_rng([settings.seed, data.number, 1])
    tested = surrogate_test(fast, settings, channel.sample_interval, rng)
    ranges = _by_range(measured, drawn, settings)
    ratios = ranges[range_column("zeta_ratio")]
    exponents, drawn_exponents, surrogate_exponents = (
        structures.exponents(settings.scaling) for structures in (measured, drawn, tested.structures)
    )
    return {
        **row,
        **statistics_row(part.series, measured, channel, settings),
        **_interval_row("flatness", drawn.flatness_at(settings.lag)),
        **_interval_row("zeta_ratio", drawn.zeta_ratio(settings.scaling)),
        **_surrogates_row(tested, settings),
        "zeta_ratio_least": float(np.min(ratios)),
        "zeta_ratio_most": float(np.max(ratios)),
        **_actuated_row(channel, settings, data.number),
        **noise_rows(noise_of(context.archive, data), settings),
        **ranges,
        "lag_time": measured.lags,
        **_curve(FLATNESS_BY_LAG, measured.flatness, drawn.flatness, tested.structures.flatness),
        **_curve(ZETA, exponents, drawn_exponents, surrogate_exponents),
    }


def _interval_row(name: str, draws: Array) -> Row:
    return _ends_row(interval_columns(name), *np.percentile(draws, INTERVAL))


def _ends_row(columns: Ends, low: float, high: float) -> Row:
    return {columns.low: float(low), columns.high: float(high)}


def _surrogates_row(tested: SurrogateTest, settings: IntermittencySettings) -> Row:
    """Rank test and envelopes."""
    return {
        "p_value": tested.p_value,
        **_envelope_row("flatness", tested.structures.flatness_at(settings.lag)),
        **_envelope_row("zeta_ratio", tested.structures.zeta_ratio(settings.scaling)),
        "surrogate_iterations": float(np.median(tested.iterations)),
        "surrogate_converged": float(tested.converged.mean()),
        "surrogate_deviation": float(np.median(tested.deviation[:, 0])),
        "surrogate_deviation_most": float(tested.deviation[:, 1].max()),
    }


def _envelope_row(name: str, values: Array) -> Row:
    return _ends_row(surrogate_columns(name), np.min(values), np.max(values))


def _by_range(
    measured: StructureFunctions, drawn: StructureFunctions, settings: IntermittencySettings
) -> dict[str, Array]:
    """Relative exponent of the sixth order and its interval ``(k,)`` for every range of lags."""
    values = [
        (float(measured.zeta_ratio(scaling)), *np.percentile(drawn.zeta_ratio(scaling), INTERVAL))
        for scaling in settings.scaling_ranges
    ]
    columns = np.array(values, dtype=np.float64).T
    return {range_column(name): column for name, column in zip(RANGE_STATISTICS, columns, strict=True)}


def _actuated_row(channel: ChannelSeries, settings: IntermittencySettings, seed: int) -> Row:
    """Compute the same statistics with the actuated samples included."""
    part = fast_part(channel, settings, actuated=True)
    fast = averaged_over(part.series, settings.interval)
    measured = resolved_structure_functions(fast, settings, channel.sample_interval)
    rng = np.random.default_rng([settings.seed, seed, 2])
    tested = surrogate_test(fast, settings, channel.sample_interval, rng)
    row = statistics_row(part.series, measured, channel, settings) | {"p_value": tested.p_value}
    return {actuated_column(name): value for name, value in row.items()}


def _curve(columns: CurveColumns, values: Array, draws: Array, surrogates: Array) -> dict[str, Array]:
    """Curve ``(m,)``, ends of its interval over draws ``(d, m)``, and envelope of the surrogates ``(s, m)``."""
    low, high = np.percentile(draws, INTERVAL, axis=0)
    return dict(zip(columns, (values, low, high, surrogates.min(axis=0), surrogates.max(axis=0)), strict=True))


# The study


def prepare(
    request: Request, archive: Archive, numbers: tuple[int, ...], settings: IntermittencySettings
) -> Preparation:
    """Determine the numbers of lags and orders, and the ranges of lags."""
    step = series_step(archive, request.estimate)
    lags = lag_samples(settings.every_lag, steps_within(settings.interval, step) * step)
    ranges = np.array(settings.scaling_ranges)
    return Preparation(
        sizes={"lag": len(lags), "order": len(ORDERS), RANGE: len(ranges)},
        variables={range_column("from"): ranges[:, 0], range_column("to"): ranges[:, 1]},
    )


STUDY = Study(
    NAME,
    "increments of a disturbance's fast part compared with surrogates",
    profile=study_profile,
    settings=IntermittencySettings,
    quick_settings={"surrogates": QUICK_SURROGATES},
    missing=missing_band,
    prepare=prepare,
)
