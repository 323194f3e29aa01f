"""Statistics of turbulence on known series: their values, and the rate at which series pass the rank test."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.known_series import (
    autoregressive,
    cascade,
    fractional_brownian_motion,
    gaussian_twin,
    shot_flatness,
    shot_train,
)
from gliderhpc.findings.formatting import markdown, number
from gliderhpc.studies.library.trends import INTERVAL
from gliderhpc.studies.library.turbulence.series import GappySeries, gappy_series, high_passed
from gliderhpc.studies.library.turbulence.statistics import (
    bootstrap_structure_functions,
    periodograms,
    power_law,
    structure_functions,
)
from gliderhpc.studies.library.turbulence.surrogates import iaaft, join_stretches, rank_p_value, spectrum_deviation

COUNT, SERIES, SURROGATES = 16384, 3, 39
LAG, SCALING = 2, (2.0, 32.0)
LAGS = np.array([1, 2, 3, 4, 6, 8, 11, 16, 23, 32])
CUTOFF, FADE = 1.0 / 256.0, 8.0
TRIALS, TRIAL_COUNT = 200, 1024
POWER_COUNTS, POWER_TRIALS = (1024, 2048, 4096), 20

Array = NDArray[np.float64]
Figures = dict[str, Any]
Made = Callable[[np.random.Generator], Array]

KNOWN: dict[str, tuple[Made, tuple[str, str, str]]] = {
    "log-Poisson cascade": (lambda rng: cascade(COUNT, rng), ("grows", "1.778", "1.696")),
    "Gaussian, the cascade's spectrum": (lambda rng: gaussian_twin(COUNT, rng), ("3", "2", "1.696")),
    "fractional Brownian motion, H = 1/3": (
        lambda rng: fractional_brownian_motion(COUNT, 1.0 / 3.0, rng), ("3", "2", "1.667"),
    ),
    "AR(2), 1.6 and -0.7": (lambda rng: autoregressive(COUNT, (1.6, -0.7), rng), ("3", "2", "none")),
    "Poisson shots, width 4, every 200": (
        lambda rng: shot_train(COUNT, 200.0, 4.0, rng), (f"{shot_flatness(200.0, 4.0, LAG):.0f}", "none", "none"),
    ),
}  # fmt: skip
"""Series by name, with what theory says of flatness, relative exponent and spectrum."""


def whole(values: Array) -> GappySeries:
    """A series that counts throughout, a second a sample."""
    return gappy_series(values, np.ones(len(values), dtype=np.bool_), 1.0)


def ranked(series: GappySeries, rng: np.random.Generator) -> tuple[float, Array, Array]:
    """P of the rank test at `LAG`; the surrogates' iterations and deviations (rms, largest) of power from 1/256 Hz on."""
    source, lag = join_stretches(series, FADE), np.array([LAG])
    own = float(structure_functions(source, lag).flatness[0])
    made = [iaaft(source.values, rng) for _ in range(SURROGATES)]
    flatness = np.array([structure_functions(source.with_values(one.values), lag).flatness[0] for one in made])
    deviation = [spectrum_deviation(one.values, source.values, 1.0, (CUTOFF, 0.1)) for one in made]
    return rank_p_value(own, flatness), np.array([one.iterations for one in made]), np.array(deviation)


def known() -> Figures:
    """Known series, how often Gaussian ones pass the rank test, and how often the cascade does."""
    rows = []
    for name, (make, theory) in KNOWN.items():
        for seed in range(SERIES):
            rng = np.random.default_rng([8, seed])
            rows.append({"series": name, "seed": seed, "theory": theory, **_known_row(make(rng), rng)})
            print(rows[-1], flush=True)
    return {"rows": rows, "false_positives": _false_positives(), "power": list(_power())}


def _known_row(values: Array, rng: np.random.Generator) -> Figures:
    series = whole(values)
    found = structure_functions(series, LAGS)
    low, high = np.percentile(
        bootstrap_structure_functions(series, LAGS, 256.0, 500, rng).zeta_ratio(SCALING), INTERVAL
    )
    law = power_law(periodograms(series, 512.0), (0.01, 0.1), 200, rng)
    p, iterations, deviation = ranked(whole(high_passed(values, 1.0, CUTOFF)), rng)
    return {
        "flatness": float(found.flatness_at(LAG)), "flatness_far": float(found.flatness_at(32.0)),
        "ratio": float(found.zeta_ratio(SCALING)), "low": float(low), "high": float(high), "beta": law.exponent,
        "beta_low": law.low, "beta_high": law.high, "p": p, "iterations": float(np.median(iterations)),
        "deviation": float(np.median(deviation[:, 0])), "deviation_most": float(deviation[:, 1].max()),
    }  # fmt: skip


def _false_positives() -> Figures:
    """Rank tests passed by Gaussian series, unbroken and with stretches left out."""
    passed = {"unbroken": 0, "in stretches": 0}
    for trial in range(TRIALS):
        rng = np.random.default_rng([9, trial])
        values = high_passed(gaussian_twin(TRIAL_COUNT, rng), 1.0, CUTOFF)
        mask = np.ones(TRIAL_COUNT, dtype=np.bool_)
        for first in rng.integers(0, TRIAL_COUNT - 30, 3):
            mask[first : first + 30] = False
        for name, counted in (("unbroken", np.ones_like(mask)), ("in stretches", mask)):
            passed[name] += ranked(gappy_series(values, counted, 1.0), rng)[0] <= 1.0 / (1 + SURROGATES) + 1e-9
    return passed


def _power() -> Iterator[Figures]:
    """Rank tests passed by cascades, and by shot trains, by the series' length."""
    for count in POWER_COUNTS:
        row = {"count": count, "cascade": 0, "shots": 0}
        for trial in range(POWER_TRIALS):
            for name in ("cascade", "shots"):
                rng = np.random.default_rng([10, trial])
                values = cascade(count, rng) if name == "cascade" else shot_train(count, 200.0, 4.0, rng)
                p = ranked(whole(high_passed(values, 1.0, CUTOFF)), rng)[0]
                row[name] += p <= 1.0 / (1 + SURROGATES) + 1e-9
        print(row, flush=True)
        yield row


def known_text(figures: Figures) -> str:
    """Table of the known series."""
    columns = ("series", "F(2)", "theory", "F(32)", "zeta_6 / zeta_3", "95 %", "theory", "beta", "theory", "p",
               "iterations", "deviation, rms", "largest")  # fmt: skip
    lines = []
    for row in figures["rows"]:
        flatness, ratio, beta = row["theory"]
        lines.append(
            (
                f"{row['series']} ({row['seed']})", number(row["flatness"]), flatness, number(row["flatness_far"]),
                f"{row['ratio']:.3f}", f"{row['low']:.2f} to {row['high']:.2f}", ratio, f"{row['beta']:.2f}", beta,
                f"{row['p']:.3f}", f"{row['iterations']:.0f}", f"{100 * row['deviation']:.3f} %",
                f"{100 * row['deviation_most']:.3f} %",
            )
        )  # fmt: skip
    return markdown(columns, lines, columns[1:])


def rates_text(figures: Figures) -> str:
    """Rates at which series pass the rank test."""
    found = figures["false_positives"]
    level = 1.0 / (1 + SURROGATES)
    error = float(np.sqrt(level * (1 - level) / TRIALS))
    lines = [
        f"Of {TRIALS} Gaussian series of {TRIAL_COUNT} samples {found['unbroken']} pass ({found['unbroken'] / TRIALS:.3f}), "
        f"and with three stretches of 30 samples left out {found['in stretches']} ({found['in stretches'] / TRIALS:.3f}); "
        f"the level is {level:.3f}, its binomial standard error {error:.3f}.",
        "",
        markdown(
            ("samples", "cascades that pass", "shot trains that pass"),
            [
                (str(row["count"]), f"{row['cascade']} of {POWER_TRIALS}", f"{row['shots']} of {POWER_TRIALS}")
                for row in figures["power"]
            ],
        ),
    ]
    return "\n".join(lines)
