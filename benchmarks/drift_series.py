"""Detection rates of the drift study's tests in random series, with and without a planted one."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc import load_platform
from gliderhpc.findings.formatting import markdown
from gliderhpc.store_schema.columns import median_column
from gliderhpc.studies.library.drift.change_points import (
    SEARCHES,
    find_changes,
    find_moment_changes,
    moment_per_degree,
)
from gliderhpc.studies.library.drift.changes import AXIAL, MOMENTS, Change
from gliderhpc.studies.library.drift.medians import DRAG, PRIMARY, ChangeSettings
from gliderhpc.studies.library.drift.shape_fits import EPISODE
from gliderhpc.studies.library.trends import SIGNIFICANCE, mann_kendall, robust_test
from gliderhpc.vocabulary import PHASES

HULL = "petrel-l"
SERIES, LENGTHS, CORRELATIONS = 200, (33, 60, 120, 240), (0.0, 0.7)

Array = NDArray[np.float64]


def autoregressive(length: int, correlation: float, rng: np.random.Generator) -> Array:
    """Stationary first-order autoregression of unit variance without a trend."""
    noise = rng.standard_normal(length)
    values = np.empty(length)
    values[0] = noise[0]
    for k in range(1, length):
        values[k] = correlation * values[k - 1] + np.sqrt(1.0 - correlation**2) * noise[k]
    return values


def false_rates(length: int, correlation: float, series: int = SERIES, resamples: int = 1000) -> tuple[float, float]:
    """Shares of series without a trend in which the plain and the robust test find one."""
    rng = np.random.default_rng(length)
    found = []
    for _ in range(series):
        values = autoregressive(length, correlation, rng)
        robust = robust_test(np.arange(float(length)), values, resamples, rng)
        found.append((mann_kendall(values)[1] < SIGNIFICANCE, robust.p < SIGNIFICANCE))
    plain, robust_rate = np.mean(found, axis=0)
    return float(plain), float(robust_rate)


def rates_text() -> str:
    """Lay the rates of false trends out."""
    rows = []
    for correlation in CORRELATIONS:
        for length in LENGTHS:
            plain, robust = false_rates(length, correlation)
            rows.append([f"{correlation:g}", str(length), f"{plain:.1%}", f"{robust:.1%}"])
    columns = ["correlation of neighbours", "values per series", "plain Mann-Kendall", "robust"]
    return f"{SERIES} seeded series per row, level 5 %.\n\n" + markdown(columns, rows, columns)


DRAWN_LENGTHS, DRAWN_CORRELATIONS = (33, 55, 120), (0.0, 0.7, 0.9)
SCATTER = 0.05
"""Relative standard deviation of the drawn medians of K_D0."""

TILT_SCATTER = 0.5
"""Standard deviation of the drawn medians of the moments, in degrees of the tilt that they cause."""

PLANTED = ((3, 4.0), (4, 4.0), (8, 3.0), (8, 5.0), (16, 3.0), (16, 5.0))
"""Profiles of a planted episode, and its size in standard deviations of the medians."""

POWER_SERIES, POWER_LENGTHS, POWER_CORRELATION = 25, (33, 55), 0.4


def drawn_medians(
    length: int, correlation: float, rng: np.random.Generator, planted: dict[str, Array] | None = None
) -> pd.DataFrame:
    """Medians of a mission: wander that the estimates of a phase share, their own scatter, and what is planted.

    Parameters
    ----------
    length : int
        Profiles.
    correlation : float
        Of neighbours.
    rng : numpy.random.Generator
        Of wander and scatter.
    planted : dict of str to (length,) array, optional
        Relative changes of K_D0 by phase.
    """
    reference, moments = load_platform(HULL).viscous.K_D0, rng.spawn(1)[0]
    table: dict[str, Array] = {"profile": np.arange(1.0, length + 1.0), "elapsed_days": 0.2 * np.arange(length)}
    for phase, effect in zip(PHASES, (-2.5, 2.5), strict=True):
        table[f"weight_effect_{phase}"] = np.full(length, effect)
        wander = SCATTER * autoregressive(length, correlation, rng) + (planted or {}).get(phase, 0.0)
        for estimate in PRIMARY:
            own = reference * (wander + 0.2 * SCATTER * rng.standard_normal(length))
            table[median_column(DRAG, phase, estimate)] = own
            table[median_column(AXIAL, phase, estimate)] = -0.1 * own + 0.01 * SCATTER * rng.standard_normal(length)
    return pd.DataFrame(table | drawn_moments(length, correlation, moments))


def drawn_moments(length: int, correlation: float, rng: np.random.Generator) -> dict[str, Array]:
    """Medians of the moments of a mission without a change, N m: wander that the estimates share, and own scatter."""
    scatter, table = TILT_SCATTER * moment_per_degree(load_platform(HULL)), dict[str, Array]()
    for name in MOMENTS:
        for phase in PHASES:
            wander = autoregressive(length, correlation, rng)
            for estimate in PRIMARY:
                own = wander + 0.2 * rng.standard_normal(length)
                table[median_column(name, phase, estimate)] = scatter * own
    return table


def planted_course(length: int, first: int, profiles: int, size: float, remaining: float = 0.5) -> Array:
    """Course of a change that comes at once, decays along a line, and is gone at once."""
    course = np.zeros(length)
    course[first : first + profiles] = size * np.linspace(1.0, remaining, profiles)
    return course


def found_changes(table: pd.DataFrame, resamples: int = 200) -> tuple[Change, ...]:
    """Change points of drag and axial force in drawn medians."""
    settings = ChangeSettings(resamples=resamples)
    return find_changes(table, load_platform(HULL).viscous.K_D0, settings, 0).found


def found_moment_changes(table: pd.DataFrame, resamples: int = 200) -> tuple[Change, ...]:
    """Change points of the moments in drawn medians."""
    return find_moment_changes(table, load_platform(HULL), ChangeSettings(resamples=resamples), 0).found


def false_changes(length: int, correlation: float, series: int, resamples: int = 200) -> float:
    """Share of drawn missions without a change in which one of drag or moments is found."""
    rng = np.random.default_rng(length)
    tables = (drawn_medians(length, correlation, rng) for _ in range(series))
    found = [bool(found_changes(one, resamples) or found_moment_changes(one, resamples)) for one in tables]
    return float(np.mean(found))


def is_found(changes: Sequence[Change], first: int, last: int) -> bool:
    """Return whether an episode is among changes, its first and last profile within two."""
    return any(one.kind == EPISODE and abs(one.first - first) <= 2 and abs(one.last - last) <= 2 for one in changes)


def power(length: int, correlation: float, profiles: int, deviations: float, missions: int) -> tuple[float, float]:
    """Shares of drawn missions whose planted episode is found, and found with its edges within two profiles."""
    rng, first = np.random.default_rng(length), length // 2
    course = planted_course(length, first, profiles, deviations * SCATTER)
    found = [found_changes(drawn_medians(length, correlation, rng, {"climb": course})) for _ in range(missions)]
    exact = [is_found(changes, first + 1, first + profiles) for changes in found]
    return float(np.mean([bool(changes) for changes in found])), float(np.mean(exact))


def changes_text(series: int) -> str:
    """Lay out the rates of false changes, and of those found, in drawn missions."""
    level = ChangeSettings().level
    columns = [
        "profiles",
        *(f"correlation {correlation:g}" for correlation in DRAWN_CORRELATIONS),
    ]
    rows = [
        [str(length), *(f"{false_changes(length, rho, series):.1%}" for rho in DRAWN_CORRELATIONS)]
        for length in DRAWN_LENGTHS
    ]
    heads = ["episode", *(f"{length} profiles" for length in POWER_LENGTHS)]
    cells = [
        [
            f"{profiles} climbs, {deviations:g} deviations",
            *(_power_cell(length, POWER_CORRELATION, profiles, deviations) for length in POWER_LENGTHS),
        ]
        for profiles, deviations in PLANTED
    ]
    return (
        f"Drawn medians, {series} missions per cell without a change, 24 series each: share in which a step, ramp or "
        f"episode of drag or of a moment is named (p below {level / SEARCHES:g} for each of both).\n\n" + markdown(columns, rows, columns)
        + f"\n\nEpisodes planted in climbs, {POWER_SERIES} missions per cell, correlation {POWER_CORRELATION:g}; size at the "
        "beginning in standard deviations of a median, half of this at the end. Share found and, in brackets, share found "
        "with first and last profile correct within two.\n\n" + markdown(heads, cells, heads[1:])
    )  # fmt: skip


def _power_cell(length: int, correlation: float, profiles: int, deviations: float) -> str:
    found, exact = power(length, correlation, profiles, deviations, POWER_SERIES)
    return f"{found:.0%} ({exact:.0%})"
