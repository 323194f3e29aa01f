"""Study ``intermittency``: increments of a disturbance's fast part compared with surrogates (section 5.3).

A profile has flatness and scaling exponents with intervals, the rank test, and the surrogates' envelopes.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.store_schema import write_table_rows, write_whole
from gliderhpc.store_schema.studies.intermittency import (
    FLATNESS_BY_LAG,
    RANGE,
    RANGE_STATISTICS,
    ZETA,
    CurveColumns,
    range_column,
)
from gliderhpc.store_schema.studies.turbulence import Ends, actuated_column, interval_columns, surrogate_columns
from gliderhpc.studies.archived import platform_of
from gliderhpc.studies.library.turbulence.series import (
    ChannelSeries,
    GappySeries,
    averaged_over,
    channel_of,
    describe_missing_band,
    fast_part,
    series_step,
    steps_within,
)
from gliderhpc.studies.library.turbulence.settings import IntermittencySettings
from gliderhpc.studies.library.turbulence.statistics import (
    COVERAGE,
    ORDERS,
    StructureFunctions,
    bootstrap_structure_functions,
    lag_samples,
    resolved_structure_functions,
    statistics_row,
    without_unresolved_lags,
)
from gliderhpc.studies.library.turbulence.surrogates import SurrogateTest, surrogate_test
from gliderhpc.studies.profile_jobs import StudiedProfile, study_profiles
from gliderhpc.studies.study import Request, Study, begin_study, choose, finish_study_group, own_assignments, provenance

NAME = "intermittency"
QUICK_SURROGATES = 9

Array = NDArray[np.float64]
Row = dict[str, Any]
Curves = dict[str, ArrayLike]


# One profile


@dataclass(frozen=True)
class IntermittencyJob:
    """One profile to study."""

    number: int
    index: int
    estimate: str
    settings: IntermittencySettings


@dataclass(frozen=True)
class StudiedIntermittency(StudiedProfile):
    """Result of a job: the profile's row, and its values by range of lags, none where it has no statistics."""

    ranges: Mapping[str, Any]


def study_profile(archive: xr.DataTree, job: IntermittencyJob) -> StudiedIntermittency:
    """Study one profile: its curves on lags and orders, and its row of the table; the job of a worker."""
    data = read_profile_data(archive, job.number, job.estimate)
    channel = channel_of(data, job.settings.channel, platform_of(archive))
    row, curves, ranges = profile_intermittency(channel, job.settings, job.number)
    return StudiedIntermittency(job.number, job.index, row, ranges, rows=curves)


def profile_intermittency(
    channel: ChannelSeries, settings: IntermittencySettings, seed: int
) -> tuple[Row, Curves, dict[str, Array]]:
    """Compute the statistics of one profile and of its surrogates.

    Parameters
    ----------
    channel : ChannelSeries
        The disturbance.
    settings : IntermittencySettings
        The study's.
    seed : int
        Of the profile's random numbers, with that of the settings; best the profile's number.

    Returns
    -------
    row : dict
        Row of the group's table; of a record that resolves nothing of the band it has the reason and no statistics.
    curves : dict of str to (m,) or (6,) array
        Curves on lags and on orders; empty for such a record.
    ranges : dict of str to (k,) array
        Relative exponents over every range of lags; empty for such a record.
    """
    part = fast_part(channel, settings, actuated=False)
    row: Row = {
        "nyquist": channel.nyquist,
        "counted": float(part.series.counted.mean()),
        "stretches": part.series.stretch_count,
    }
    if part.message:
        return {**row, "message": part.message}, {}, {}
    fast = averaged_over(part.series, settings.interval)
    found = resolved_structure_functions(fast, settings, channel.sample_interval)
    drawn = _bootstrap(fast, settings, channel.sample_interval, np.random.default_rng([settings.seed, seed, 0]))
    tested = surrogate_test(fast, settings, np.random.default_rng([settings.seed, seed, 1]))
    row |= statistics_row(part.series, found, channel, settings)
    row |= _interval_row("flatness", drawn.flatness_at(settings.lag))
    row |= _interval_row("zeta_ratio", drawn.zeta_ratio(settings.scaling))
    row |= _surrogates_row(tested, settings, found)
    ranges = _by_range(found, drawn, settings)
    ratios = ranges[range_column("zeta_ratio")]
    row |= {"zeta_ratio_least": float(np.min(ratios)), "zeta_ratio_most": float(np.max(ratios))}
    row |= _actuated_row(channel, settings, seed)
    exponents, drawn_exponents, surrogate_exponents = (
        one.exponents(settings.scaling) for one in (found, drawn, tested.structures)
    )
    curves: Curves = {
        "lag_time": found.lags,
        **_curve(FLATNESS_BY_LAG, found.flatness, drawn.flatness, tested.structures.flatness),
        **_curve(ZETA, exponents, drawn_exponents, surrogate_exponents),
    }
    return row, curves, ranges


def _bootstrap(
    fast: GappySeries, settings: IntermittencySettings, sample_interval: float, rng: np.random.Generator
) -> StructureFunctions:
    lags = lag_samples(settings.every_lag, fast.step)
    drawn = bootstrap_structure_functions(fast, lags, settings.block, settings.block_draws, rng)
    return without_unresolved_lags(drawn, sample_interval)


def _interval_row(name: str, draws: Array) -> Row:
    return _ends_row(interval_columns(name), *np.percentile(draws, COVERAGE))


def _ends_row(columns: Ends, low: float, high: float) -> Row:
    return {columns.low: float(low), columns.high: float(high)}


def _surrogates_row(tested: SurrogateTest, settings: IntermittencySettings, found: StructureFunctions) -> Row:
    """Rank test and envelopes; the test has no p at a lag that the records do not resolve."""
    resolved = bool(np.isfinite(found.flatness_at(settings.lag)))
    return {
        "p_value": tested.p_value if resolved else float("nan"),
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
    found: StructureFunctions, drawn: StructureFunctions, settings: IntermittencySettings
) -> dict[str, Array]:
    """Relative exponent of the sixth order and its interval ``(k,)`` over every range of lags."""
    values = [
        (float(found.zeta_ratio(scaling)), *np.percentile(drawn.zeta_ratio(scaling), COVERAGE))
        for scaling in settings.scaling_ranges
    ]
    columns = np.array(values, dtype=np.float64).T
    return {range_column(name): column for name, column in zip(RANGE_STATISTICS, columns, strict=True)}


def _actuated_row(channel: ChannelSeries, settings: IntermittencySettings, seed: int) -> Row:
    """Compute the same statistics with the actuated samples included."""
    part = fast_part(channel, settings, actuated=True)
    fast = averaged_over(part.series, settings.interval)
    found = resolved_structure_functions(fast, settings, channel.sample_interval)
    tested = surrogate_test(fast, settings, np.random.default_rng([settings.seed, seed, 2]))
    row = statistics_row(part.series, found, channel, settings) | {"p_value": tested.p_value}
    return {actuated_column(name): value for name, value in row.items()}


def _curve(columns: CurveColumns, values: Array, draws: Array, surrogates: Array) -> Curves:
    """Values of a curve ``(m,)``, ends of their interval over draws ``(d, m)``, and the envelope of ``(s, m)``."""
    low, high = np.percentile(draws, COVERAGE, axis=0)
    return dict(zip(columns, (values, low, high, surrogates.min(axis=0), surrogates.max(axis=0)), strict=True))


# The mission


def run(request: Request) -> None:
    """Study the chosen profiles, into the archive's group ``intermittency``.

    Raises
    ------
    InputError
        No such profile is done, the archive has no such estimate, or a setting is wrong.
    """
    settings = _settings(request)
    with open_for_reading(request.archive) as archive:
        chosen, step = choose(archive, request), series_step(archive, request.estimate)
    interval = steps_within(settings.interval, step) * step
    jobs = [IntermittencyJob(number, chosen.where[number], request.estimate, settings) for number in chosen.numbers]
    ranges = np.array(settings.scaling_ranges)
    sizes = {"lag": len(lag_samples(settings.every_lag, interval)), "order": len(ORDERS), RANGE: len(ranges)}
    remarks = chosen.remarks + begin_study(request, NAME, sizes)
    results = study_profiles(request, NAME, study_profile, jobs)
    write_table_rows(request.archive, {result.index: result.ranges for result in results}, NAME)
    write_whole(request.archive, NAME, {range_column("from"): ranges[:, 0], range_column("to"): ranges[:, 1]})
    rows = {result.number: result.row for result in results}
    made = provenance(request, rows, settings.model_dump(mode="json"), remarks)
    finish_study_group(request.archive, NAME, made)


def missing(request: Request) -> str | None:
    """Say why the records are sampled too rarely for this study, None where they are not."""
    return describe_missing_band(request, _settings(request))


def _settings(request: Request) -> IntermittencySettings:
    base = {"surrogates": QUICK_SURROGATES} if request.quick else {}
    return build_settings_of(IntermittencySettings, base, own_assignments(request, NAME))


STUDY = Study(NAME, "increments of a disturbance's fast part beside surrogates", missing, run)
"""The study that the registry finds."""
