"""Results of the studies of turbulence on known series, on twins, on a simulated mission and on a real one.

Usage: ``python -m benchmarks.turbulence known twins power levels spectra intermittency nulls paper real --mission
ARCHIVE.zarr --levels ARCHIVE.zarr --paper ARCHIVE.zarr --real ARCHIVE.zarr --work DIR`` runs the sections that are named,
stores each one's figures in ``DIR/SECTION.json``, and writes ``docs/turbulence.md`` from ``benchmarks/turbulence.md`` and
all that is there. The sections of the studies' names run these on the archive of `--mission`; `paper` runs two of them on
one that preset `paper` made, and `levels` makes 200 nulls of each kind in the archive of `--levels`, in place of its own.
"""

import argparse
import json
import os
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.machine import machine_row
from benchmarks.turbulence_power import DEPTH, PICTURE, SEEDS, gusty, power, power_figure, power_text
from benchmarks.turbulence_series import COUNT, SERIES, SURROGATES, Figures, known, known_text, rates_text
from gliderhpc import load_platform
from gliderhpc.api.studies import analyze_archive
from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import ADJOINT
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.preparation import PreparedProfile, prepare_profile
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profiles
from gliderhpc.estimation.resample import on_steps
from gliderhpc.findings.drawing import render_image
from gliderhpc.findings.formatting import markdown, number
from gliderhpc.findings.results import as_plain
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.executors import local_executor
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.report.studies.turbulence import LABELS, table_3_text, verdict_text
from gliderhpc.simulator import simulate_profile
from gliderhpc.store_schema.columns import FAMILIES
from gliderhpc.studies.library.turbulence.contrast import LEVEL
from gliderhpc.studies.library.turbulence.ensembles import Ensembles, null_table, stored_measured, stored_nulls
from gliderhpc.studies.library.turbulence.series import (
    GappySeries,
    IntermittencySettings,
    averaged_over,
    channel_of_estimate,
    fast_part,
)
from gliderhpc.studies.library.turbulence.statistics import (
    resolved_structure_functions,
    statistics_row,
)
from gliderhpc.studies.library.turbulence.surrogates import (
    surrogate_test,
)
from gliderhpc.studies.library.turbulence.verdict import judge
from gliderhpc.studies.request import Request
from gliderhpc.twins.scoring import boundaries_of, near_boundaries

TEMPLATE = Path(__file__).with_suffix(".md")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "turbulence.md"
TWIN_SEEDS, TWIN_RMS = 4, (0.0, 0.002, 0.008, 0.016, 0.032, 0.064)
RANK_LEVEL = 1.0 / (1 + SURROGATES) + 1e-9
LEVEL_NULLS = 200
"""Number of nulls of each kind in section `levels`."""


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
        seams = at_seams(estimate, part.series)
        row = {"kind": kind, "gust": rms, "seed": seed, "p": p, "at_seams": seams.moment, "seams_time": seams.time}
        rows.append(row | statistics_row(part.series, found, series, settings))
        print(rows[-1], flush=True)
    return {"rows": rows}


class SeamShares(NamedTuple):
    """Shares of the fourth moment and of the time within a second of where one window's solution follows another's."""

    moment: float
    time: float


def at_seams(estimate: ProfileEstimate, series: GappySeries) -> SeamShares:
    """Shares at the seams of an estimate's windows."""
    near = near_boundaries(boundaries_of(estimate.solution.source), len(series.values), series.step)[series.counted]
    fourth = series.values[series.counted] ** 4
    return SeamShares(float(fourth[near].sum() / fourth.sum()), float(near.mean()))


def study(name: str, archive: Path, workers: int, assignments: tuple[str, ...] = ()) -> Figures:
    """One study on an archive, what it took, and what the archive says after it."""
    began, began_cpu = time.perf_counter(), _cpu()
    analyze_archive(name, Request(archive, lambda: local_executor(workers), assignments=assignments))
    seconds, cpu = time.perf_counter() - began, _cpu() - began_cpu
    return {"seconds": seconds, "cpu": cpu, "workers": workers, **verdict_figures(archive)}


def levels(archive: Path, workers: int) -> Figures:
    """Nulls of each kind that the tests reject; the group of the archive's own nulls is replaced."""
    began = time.perf_counter()
    counts = tuple(f"nulls.{family}={LEVEL_NULLS}" for family in FAMILIES)
    analyze_archive("nulls", Request(archive, lambda: local_executor(workers), assignments=counts))
    with open_for_reading(archive) as opened:
        table = null_table(opened)
    rows = table[["family", "p_value", "gaussianity_p_value", "gaussianity_score"]].to_dict("records")
    return {"rows": rows, "seconds": time.perf_counter() - began, "workers": workers}


def levels_text(figures: Figures) -> str:
    """Table of the nulls that each test rejects."""
    error = float(np.sqrt(LEVEL * (1.0 - LEVEL) / LEVEL_NULLS))
    lines = []
    for family in FAMILIES:
        own = [row for row in figures["rows"] if row["family"] == family]
        p, rank = (np.array([row[name] for row in own], dtype=float) for name in ("gaussianity_p_value", "p_value"))
        tested, rejected, passed = int(np.isfinite(p).sum()), int((p <= LEVEL).sum()), int((rank <= RANK_LEVEL).sum())
        share = f"{rejected} ({rejected / tested:.3f})" if tested else "–"
        lines.append((LABELS[family], str(len(own)), str(tested), share, str(passed)))
    columns = (
        "nulls",
        "number",
        "tested",
        "rejected as not Gaussian",
        f"passed the rank test (level {RANK_LEVEL:.3f})",
    )
    return (
        f"{markdown(columns, lines, columns[1:])}\n\nThe level is {LEVEL:g}, its binomial standard error with "
        f"{LEVEL_NULLS} nulls {error:.3f}. They took {figures['seconds'] / 60.0:.1f} min with {figures['workers']} workers."
    )


def paper(archive: Path, workers: int) -> Figures:
    """Increments and nulls of an archive that preset `paper` made."""
    study("intermittency", archive, workers)
    return study("nulls", archive, workers, ("nulls.gaussian=0",))


def real(archive: Path) -> Figures:
    """Reasons for which the studies refuse a real mission, by study; none if they do not."""
    request, refused = Request(archive, lambda: local_executor(0)), {}
    for name in ("spectra", "intermittency"):
        try:
            analyze_archive(name, request)
        except InputError as error:
            refused[name] = str(error).removeprefix(f"{name}: ")
    return {"archive": archive.stem, "refused": refused, **verdict_figures(archive)}


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


def twins_text(figures: Figures) -> str:
    """Table of the twins, strength by strength, relative to the ceiling of those without gusts."""
    rows = figures["rows"]
    ceiling = max(row["peak"] for row in rows if row["kind"] == "none")
    lines = []
    for rms in TWIN_RMS:
        for kind in ("none", "cascade", "gaussian"):
            own = [row for row in rows if row["kind"] == kind and row["gust"] == rms]
            if own:
                lines.append(
                    (
                        kind, f"{1000 * rms:g}", _spread(own, "peak"), f"{_median(own, 'peak') / ceiling:.2f}",
                        _spread(own, "kurtosis"), _spread(own, "flatness"), _spread(own, "zeta_ratio"),
                        _spread(own, "beta_resolved"), _spread(own, "at_seams"), f"{sum(row['p'] <= RANK_LEVEL for row in own)} of {len(own)}",
                    )
                )  # fmt: skip
    shares = [
        f"{1000 * rms:g} mm/s {_share_above(rows, rms, 'flatness'):.2f} and {_share_above(rows, rms, 'kurtosis'):.2f}"
        for rms in TWIN_RMS[1:]
    ]
    moment, time_share = (np.array([row[name] for row in rows]) for name in ("at_seams", "seams_time"))
    error = moment.std(ddof=1) / np.sqrt(len(moment))
    columns = ("gust", "rms, mm/s", "largest amplitude, N m", "median over the ceiling", "kurtosis", "F(1 s)",
               "zeta_6 / zeta_3", "beta, resolved", "share at seams", "rank tests passed")  # fmt: skip
    return (
        f"The ceiling of the twins without gusts is {number(ceiling)} N m.\n\n{markdown(columns, lines, columns[1:])}\n\n"
        f"Share of the fourth moment at the seams, mean over the {len(rows)} twins: {moment.mean():.3f} (standard error "
        f"{error:.3f}), that of the time {time_share.mean():.3f}; ratio {moment.mean() / time_share.mean():.2f}.\n\n"
        "Share of pairs of twins of the same strength in which the cascade's statistic is larger than the Gaussian gust's, "
        f"F(1 s) and kurtosis: {'; '.join(shares)}. One half is expected by chance; with one they could always be "
        "distinguished."
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
        f"{_below(last['text'])}\n{markdown(columns, lines, columns[1:])}\n\nComputing time in all {total / 60:.1f} "
        f"min, on {last['machine']['cpu']}, {last['machine']['cores']} cores. The load is the one-minute average of "
        "processes ready to run at the end, including those of other work; without worker processes (0) a single "
        "process does all the work."
    )


def real_text(figures: Figures) -> str:
    """Reasons for which the studies refuse the real mission, or their verdict."""
    if not figures["refused"]:
        return _below(figures["text"])
    reasons = " ".join(f'"{reason}".' for reason in dict.fromkeys(figures["refused"].values()))
    return f"The studies refuse {figures['archive']}: {reasons}"


def _below(text: str) -> str:
    """Text with headings one level below the page's own."""
    return text.replace("\n## ", "\n### ").replace("# Intermittency and nulls\n\n", "")


STUDIES = ("spectra", "intermittency", "nulls")
NOT_RUN = "This section has not been run."

TEXTS: dict[str, dict[str, Callable[[Figures], str]]] = {
    "known": {"known": known_text, "rates": rates_text},
    "twins": {"twins": twins_text},
    "power": {"power": power_text},
    "levels": {"levels": levels_text},
    "paper": {"paper": lambda figures: _below(figures["text"])},
    "real": {"real": real_text},
}


def main() -> None:
    """Run the sections that are named and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sections", nargs="*", choices=[*TEXTS, *STUDIES, []])
    parser.add_argument("--mission", type=Path)
    parser.add_argument("--levels", type=Path)
    parser.add_argument("--paper", type=Path)
    parser.add_argument("--real", type=Path)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--work", type=Path, required=True)
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    sections: dict[str, Callable[[], Figures]] = {
        "known": known,
        "twins": twins,
        "power": lambda: power(options.workers),
        "levels": lambda: levels(options.levels, options.workers),
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
    found = stored_figures(options.work, "power")
    if found is not None:
        PICTURE.write_bytes(render_image(power_figure(found), "png"))
    sizes = {"count": COUNT, "series": SERIES, "seeds": TWIN_SEEDS, "depth": f"{DEPTH:g}", "power_seeds": len(SEEDS)}
    PAGE.write_text(TEMPLATE.read_text("utf-8").format(**parts, **sizes), "utf-8")


if __name__ == "__main__":
    main()
