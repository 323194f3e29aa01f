"""Results of the studies of turbulence on known series, on twins, on a simulated mission and on a real one.

Usage: ``python -m benchmarks.turbulence known twins spectra intermittency nulls paper real --mission ARCHIVE.zarr --paper
ARCHIVE.zarr --real ARCHIVE.zarr --work DIR`` runs the sections that are named, stores each one's figures in
``DIR/SECTION.json``, and writes ``docs/turbulence.md`` from ``benchmarks/turbulence.md`` and all that is there. The
sections of the studies' names run these on the archive of `--mission` and take the time; `paper` runs two of them on one
that preset `paper` made.
"""

import argparse
import json
import os
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.known_series import (
    autoregressive,
    cascade,
    fractional_brownian_motion,
    gaussian_twin,
    shot_flatness,
    shot_train,
)
from benchmarks.machine import machine_row
from gliderhpc import load_platform
from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import ADJOINT
from gliderhpc.errors import ProfileError
from gliderhpc.estimation.preparation import PreparedProfile, on_steps, prepare_profile
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profiles
from gliderhpc.findings.findings import as_plain, markdown, number
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.executors import local_executor
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.report.studies import analyze_archive
from gliderhpc.report.studies.turbulence import table_3_text, verdict_text
from gliderhpc.simulator import Scenario, simulate_profile
from gliderhpc.studies.library.trends import INTERVAL
from gliderhpc.studies.library.turbulence.series import (
    GappySeries,
    IntermittencySettings,
    averaged_over,
    channel_of_estimate,
    fast_part,
    gappy_series,
    high_passed,
)
from gliderhpc.studies.library.turbulence.statistics import (
    bootstrap_structure_functions,
    periodograms,
    power_law,
    resolved_structure_functions,
    statistics_row,
    structure_functions,
)
from gliderhpc.studies.library.turbulence.surrogates import (
    iaaft,
    joined,
    rank_p_value,
    spectrum_deviation,
    surrogate_test,
)
from gliderhpc.studies.library.turbulence.verdict import Ensembles, judge, stored_measured, stored_nulls
from gliderhpc.studies.study import Request
from gliderhpc.twins.cases import QUIET, world
from gliderhpc.twins.scoring import boundaries_of, near_boundaries

TEMPLATE = Path(__file__).with_suffix(".md")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "turbulence.md"
COUNT, SERIES, SURROGATES = 16384, 3, 39
LAG, SCALING = 2, (2.0, 32.0)
LAGS = np.array([1, 2, 3, 4, 6, 8, 11, 16, 23, 32])
CUTOFF, FADE = 1.0 / 256.0, 8.0
TRIALS, TRIAL_COUNT = 200, 1024
POWER_COUNTS, POWER_TRIALS = (1024, 2048, 4096), 20
TWIN_DEPTH, TWIN_SEEDS, TWIN_RMS = 120.0, 4, (0.0, 0.002, 0.008, 0.016, 0.032, 0.064)

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
    source, lag = joined(series, FADE), np.array([LAG])
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


def twins() -> Figures:
    """Twins in intermittent and in Gaussian gusts of several strengths, and none, through the pipeline."""
    platform, settings, mission = load_platform("petrel-l"), IntermittencySettings(), MissionSettings()
    cases = [
        (kind, rms, seed)
        for rms in TWIN_RMS
        for kind in (("cascade", "gaussian") if rms else ("none",))
        for seed in range(TWIN_SEEDS)
    ]

    def tasks() -> Iterator[tuple[tuple[str, float, int], PreparedProfile]]:
        for kind, rms, seed in cases:
            record, _ = simulate_profile(platform, gusty(kind, rms), seed, number=1 + seed % 2)
            yield (kind, rms, seed), prepare_profile(Glider(platform), on_steps(record, mission))

    rows = []
    for (kind, rms, seed), estimate in estimate_profiles(tasks(), mission):
        if isinstance(estimate, ProfileError):
            print(f"left out, {kind} {rms:g} m/s, seed {seed}: {estimate}", flush=True)
            continue
        series = channel_of_estimate(estimate, settings.channel, ADJOINT, mission.steps_per_record)
        part = fast_part(series, settings, actuated=False)
        fast = averaged_over(part.series, settings.interval)
        found = resolved_structure_functions(fast, settings, series.sample_interval)
        p = surrogate_test(fast, settings, np.random.default_rng([11, seed])).p_value
        row = {"kind": kind, "gust": rms, "seed": seed, "p": p, "at_seams": at_seams(estimate, part.series)}
        rows.append(row | statistics_row(part.series, found, series, settings))
        print(rows[-1], flush=True)
    return {"rows": rows}


def at_seams(estimate: ProfileEstimate, series: GappySeries) -> float:
    """Share of the fourth moment within a second of where one window's solution ends and the next begins."""
    near = near_boundaries(boundaries_of(estimate.solution.source), len(series.values), series.step)
    fourth = series.values**4
    return float(fourth[series.counted & near].sum() / fourth[series.counted].sum())


def gusty(kind: str, rms: float) -> Scenario:
    """Still water but for gusts of a kind and strength (m/s)."""
    still = world(TWIN_DEPTH, disturbances=QUIET)
    gusts = {"kind": kind, "rms": rms, "outer": 128.0, "inner": 0.25}
    return still.replaced({"gusts": gusts, "current": {"speed": [0.0, 0.0]}})


def study(name: str, archive: Path, workers: int, assignments: tuple[str, ...] = ()) -> Figures:
    """One study on an archive, what it took, and what the archive says after it."""
    began, began_cpu = time.perf_counter(), _cpu()
    analyze_archive(name, Request(archive, lambda: local_executor(workers), assignments=assignments))
    seconds, cpu = time.perf_counter() - began, _cpu() - began_cpu
    return {"seconds": seconds, "cpu": cpu, "workers": workers, **verdict_figures(archive)}


def paper(archive: Path, workers: int) -> Figures:
    """Increments and nulls of an archive that preset `paper` made."""
    study("intermittency", archive, workers)
    return study("nulls", archive, workers, ("nulls.gaussian=0",))


def real(archive: Path) -> Figures:
    """Spectra and intermittency of a real mission: reasons where they have no numbers, and the verdict."""
    request = Request(archive, lambda: local_executor(0))
    failed = {}
    for name in ("spectra", "intermittency"):
        findings = analyze_archive(name, request)
        failed[name] = dict(findings.failed)
    return {"archive": archive.stem, "failed": failed, **verdict_figures(archive)}


def verdict_figures(archive: Path) -> Figures:
    """Table 3 and verdict of an archive as text."""
    with open_for_reading(archive) as opened:
        measured, settings = stored_measured(opened, ADJOINT)
        if settings is None:
            return {"text": ""}
        ensembles = Ensembles(measured, stored_nulls(opened, ADJOINT, settings)[0], settings)
    return {"text": table_3_text(ensembles) + "\n" + verdict_text(judge(ensembles)), "profiles": len(measured)}


def _cpu() -> float:
    """Computing time of this process and of its children that have ended, s."""
    return sum(os.times()[:4])


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


def twins_text(figures: Figures) -> str:
    """Table of the twins, strength by strength, relative to the ceiling of those without gusts."""
    rows = figures["rows"]
    ceiling = max(row["peak"] for row in rows if row["kind"] == "none")
    level = 1.0 / (1 + SURROGATES) + 1e-9
    lines = []
    for rms in TWIN_RMS:
        for kind in ("none", "cascade", "gaussian"):
            own = [row for row in rows if row["kind"] == kind and row["gust"] == rms]
            if own:
                lines.append(
                    (
                        kind, f"{1000 * rms:g}", _spread(own, "peak"), f"{_median(own, 'peak') / ceiling:.2f}",
                        _spread(own, "kurtosis"), _spread(own, "flatness"), _spread(own, "zeta_ratio"),
                        _spread(own, "beta_resolved"), _spread(own, "at_seams"), f"{sum(row['p'] <= level for row in own)} of {len(own)}",
                    )
                )  # fmt: skip
    shares = [
        f"{1000 * rms:g} mm/s {_share_above(rows, rms, 'flatness'):.2f} and {_share_above(rows, rms, 'kurtosis'):.2f}"
        for rms in TWIN_RMS[1:]
    ]
    columns = ("gust", "rms, mm/s", "largest amplitude, N m", "median over the ceiling", "kurtosis", "F(1 s)",
               "zeta_6 / zeta_3", "beta, resolved", "share at seams", "rank tests passed")  # fmt: skip
    return (
        f"The ceiling of the twins without gusts is {number(ceiling)} N m.\n\n{markdown(columns, lines, columns[1:])}\n\n"
        "Share of pairs of twins of the same strength in which the cascade's statistic is larger than the Gaussian gust's, "
        f"F(1 s) and kurtosis: {'; '.join(shares)}. One half is chance; one would tell them apart every time."
    )


def _share_above(rows: list[Figures], rms: float, name: str) -> float:
    """Share of pairs in which the cascade's statistic is larger."""
    ours, theirs = (
        np.array([row[name] for row in rows if row["kind"] == kind and row["gust"] == rms])
        for kind in ("cascade", "gaussian")
    )
    return float(np.mean(ours[:, None] > theirs[None, :])) if ours.size and theirs.size else float("nan")


def _median(rows: list[Figures], name: str) -> float:
    return float(np.median([row[name] for row in rows]))


def _spread(rows: list[Figures], name: str) -> str:
    values = [row[name] for row in rows]
    return f"{number(min(values))} to {number(max(values))}"


def stored_figures(work: Path, section: str) -> Figures | None:
    """Figures of a section that was run, None of one that was not."""
    path = work / f"{section}.json"
    return json.loads(path.read_text("utf-8")) if path.exists() else None


def mission_text(work: Path) -> str:
    """Table 3 and verdict of the simulated mission after the last study, and what each study took."""
    figures = {name: one for name in STUDIES if (one := stored_figures(work, name)) is not None}
    if not figures:
        return NOT_RUN
    lines = [
        (name, f"{one['seconds']:.0f}", f"{one['cpu']:.0f}", str(one["workers"]), f"{one['machine']['load']:.0f}")
        for name, one in figures.items()
    ]
    last = list(figures.values())[-1]
    columns = ("study", "time, s", "computing time, s", "worker processes", "load")
    total = sum(one["cpu"] for one in figures.values())
    return (
        f"{_below(last['text'])}\n{markdown(columns, lines, columns[1:])}\n\nComputing time in all "
        f"{total / 60:.1f} min, on {last['machine']['cpu']}, {last['machine']['cores']} cores. The load is the one-minute "
        "average of processes ready to run at the end, other work's included; without worker processes (0) one process "
        "does it all."
    )


def real_text(figures: Figures) -> str:
    """Reasons for which the real profiles have no numbers."""
    reasons = sorted({reason for failed in figures["failed"].values() for reason in failed.values()})
    count = len(figures["failed"]["spectra"])
    return f"{count} profiles without a number, {figures.get('profiles', 0)} with. " + " ".join(
        f'"{r}".' for r in reasons
    )


def _below(text: str) -> str:
    """Text whose headings stand below the page's own."""
    return text.replace("\n## ", "\n### ").replace("# Intermittency and nulls\n\n", "")


STUDIES = ("spectra", "intermittency", "nulls")
NOT_RUN = "This section has not been run."

TEXTS: dict[str, dict[str, Callable[[Figures], str]]] = {
    "known": {"known": known_text, "rates": rates_text},
    "twins": {"twins": twins_text},
    "paper": {"paper": lambda figures: _below(figures["text"])},
    "real": {"real": real_text},
}


def main() -> None:
    """Run the sections that are named and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sections", nargs="*", choices=[*TEXTS, *STUDIES, []])
    parser.add_argument("--mission", type=Path)
    parser.add_argument("--paper", type=Path)
    parser.add_argument("--real", type=Path)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--work", type=Path, required=True)
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    sections: dict[str, Callable[[], Figures]] = {
        "known": known,
        "twins": twins,
        **{name: partial(study, name, options.mission, options.workers) for name in STUDIES},
        "paper": lambda: paper(options.paper, options.workers),
        "real": lambda: real(options.real),
    }
    for name in options.sections:
        with threadpool_limits(limits=1):
            figures = sections[name]() | {"machine": machine_row()}
        (options.work / f"{name}.json").write_text(json.dumps(as_plain(figures), indent=1) + "\n", "utf-8")
    parts = {"mission": mission_text(options.work)}
    for name, texts in TEXTS.items():
        figures = stored_figures(options.work, name)
        parts |= {part: NOT_RUN if figures is None else write(figures) for part, write in texts.items()}
    sizes = {"count": COUNT, "series": SERIES, "seeds": TWIN_SEEDS, "depth": f"{TWIN_DEPTH:g}"}
    PAGE.write_text(TEMPLATE.read_text("utf-8").format(**parts, **sizes), "utf-8")


if __name__ == "__main__":
    main()
