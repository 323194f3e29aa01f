"""Power of one profile to distinguish an intermittent gust from a Gaussian one, by hull, logger, strength and count.

Every twin is simulated, filtered, smoothed and inverted with the default settings, and tested by the score of its
standardised noise (`gliderhpc.studies.library.turbulence.gaussianity`).
"""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.turbulence_series import Figures
from gliderhpc import load_platform
from gliderhpc.errors import ProfileError
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.profile import estimate_profile
from gliderhpc.estimation.resample import on_steps
from gliderhpc.findings.drawing import label, legend, new_figure, style_axes
from gliderhpc.findings.formatting import markdown
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.executors import local_executor
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.platform import Platform
from gliderhpc.simulator import Scenario, simulate_profile
from gliderhpc.studies.library.turbulence.contrast import LEVEL
from gliderhpc.studies.library.turbulence.gaussianity import noise_of_estimate, noise_rows
from gliderhpc.studies.library.turbulence.series import IntermittencySettings
from gliderhpc.twins.cases import QUIET, world

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "assets" / "turbulence-power.png"

INTERVALS = {"petrel-l": (0.1, 0.2, 0.5, 1.0), "slocum": (0.2, 0.5, 1.0)}
RESOLUTIONS = (0.01, 0.1)
STRENGTHS, KINDS = (0.001, 0.004, 0.016, 0.064), ("cascade", "gaussian")
SEEDS, DEPTH = range(400, 410), 120.0
COUNTS = (1, 9, 100)
"""Numbers of profiles that are pooled."""

ENOUGH = 0.9
"""Share of pairs from which the two kinds are distinguished."""

DRAWS = 2000
"""Resampled missions for the pooled shares."""

Array = NDArray[np.float64]


class Logger(NamedTuple):
    """A hull and how its logger samples attitude: interval in s, resolution in degrees."""

    hull: str
    interval: float
    resolution: float

    def platform(self) -> Platform:
        """Return the hull with this logger."""
        hull = load_platform(self.hull)
        sensors = {"sample_interval": self.interval, "attitude_resolution": self.resolution}
        return hull.model_copy(update={"sensors": hull.sensors.model_copy(update=sensors)})


class Twin(NamedTuple):
    """A twin of the table."""

    logger: Logger
    strength: float
    kind: str
    seed: int


def gusty(kind: str, rms: float) -> Scenario:
    """Still water but for gusts of a kind and strength (m/s)."""
    still = world(DEPTH, disturbances=QUIET)
    gusts = {"kind": kind, "rms": rms, "outer": 128.0, "inner": 0.25}
    return still.replaced({"gusts": gusts, "current": {"speed": [0.0, 0.0]}})


def score_of(twin: Twin) -> Figures:
    """Score and p-value of a twin; NaN where no channel is tested or the record cannot be used."""
    platform, settings = twin.logger.platform(), MissionSettings()
    row: Figures = {**twin.logger._asdict(), "strength": twin.strength, "kind": twin.kind, "seed": twin.seed}
    with threadpool_limits(limits=1):
        record, _ = simulate_profile(platform, gusty(twin.kind, twin.strength), twin.seed, number=1 + twin.seed % 2)
        try:
            estimate = estimate_profile(prepare_profile(Glider(platform), on_steps(record, settings)), settings)
        except ProfileError as error:
            return row | {"gaussianity_score": float("nan"), "gaussianity_p_value": float("nan"), "message": str(error)}
        return row | noise_rows(noise_of_estimate(estimate, settings.steps_per_record), IntermittencySettings())


def power(workers: int) -> Figures:
    """Scores of all twins."""
    twins = [Twin(*each) for each in product(loggers(), STRENGTHS, KINDS, SEEDS)]
    with local_executor(workers) as executor:
        rows = []
        for row in executor.run(score_of, twins):
            rows.append(row)
            print(row, flush=True)
    return {"rows": rows}


class Cell(NamedTuple):
    """Results of the twins of a logger and strength.

    Attributes
    ----------
    shares : (c,) array
        Shares of pairs of missions, of as many profiles as `COUNTS`, in which the cascades have the larger mean score.
    false : float
        Share of the Gaussian gusts, among those tested, that one profile's test rejects at `LEVEL`; NaN if none is.
    tested : float
        Share of the twins that are tested.
    """

    shares: Array
    false: float
    tested: float


def cell_of(rows: list[Figures]) -> Cell:
    """Summarise the twins of a logger and strength.

    Missions are resampled from the twins that are tested, after these have been resampled themselves, as they are few. A
    pair with a mission that cannot be tested shows nothing, and counts one half.
    """
    rng = np.random.default_rng(28)
    of_kind = {kind: _values(rows, kind, "gaussianity_score") for kind in KINDS}
    known = {kind: scores[np.isfinite(scores)] for kind, scores in of_kind.items()}
    untested = [1.0 - len(known[kind]) / len(of_kind[kind]) for kind in KINDS]
    p = _values(rows, "gaussian", "gaussianity_p_value")
    p = p[np.isfinite(p)]
    shares = np.full(len(COUNTS), 0.5)
    if max(untested) < 1.0:
        for at, count in enumerate(COUNTS):
            both = float(np.prod([1.0 - share**count for share in untested]))
            ours, theirs = (_resampled_means(known[kind], count, rng) for kind in KINDS)
            shares[at] = both * np.mean(ours > theirs) + 0.5 * (1.0 - both)
    tested = sum(len(one) for one in known.values()) / sum(len(one) for one in of_kind.values())
    return Cell(shares, float(np.mean(p <= LEVEL)) if len(p) else float("nan"), tested)


def _values(rows: list[Figures], kind: str, name: str) -> Array:
    """Values of the twins of a kind, NaN where there is none."""
    return np.array([row[name] for row in rows if row["kind"] == kind], dtype=np.float64)


def _resampled_means(scores: Array, count: int, rng: np.random.Generator) -> Array:
    """Mean scores ``(d,)`` of missions of `count` profiles, drawn from resampled scores."""
    pools = scores[rng.integers(0, len(scores), (DRAWS, len(scores)))]
    chosen = rng.integers(0, len(scores), (DRAWS, count))
    return np.asarray(np.take_along_axis(pools, chosen, axis=1).mean(axis=1))


def loggers() -> list[Logger]:
    """Hulls and loggers of the table."""
    return [
        Logger(hull, interval, resolution)
        for hull, intervals in INTERVALS.items()
        for interval in intervals
        for resolution in RESOLUTIONS
    ]


def cells(figures: Figures) -> dict[tuple[Logger, float], Cell]:
    """Return the cells of the table."""
    found = {}
    for logger, strength in product(loggers(), STRENGTHS):
        own = [
            row
            for row in figures["rows"]
            if (row["hull"], row["interval"], row["resolution"]) == logger and row["strength"] == strength
        ]
        found[logger, strength] = cell_of(own)
    return found


def power_text(figures: Figures) -> str:
    """Table of the shares of pairs, and what it says to an operator."""
    columns = ("hull", "interval, s", "resolution, degrees", *(f"{1000 * rms:g} mm/s" for rms in STRENGTHS))
    found = cells(figures)
    lines = []
    for logger in loggers():
        shares = [_cell_text(found[logger, rms]) for rms in STRENGTHS]
        lines.append((logger.hull, f"{logger.interval:g}", f"{logger.resolution:g}", *shares))
    return (
        f"{markdown(columns, lines, columns[1:])}\n\n{_weakest(found)}\n\nIn Gaussian gusts the test of one profile rejects "
        f"{_rate(figures, 'gaussian')} at a level of {LEVEL:g}; in cascades it rejects {_rate(figures, 'cascade')}, and at "
        f"1 s and 0.1 degrees {_rate(figures, 'cascade', interval=1.0, resolution=0.1)}."
    )


def _cell_text(cell: Cell) -> str:
    if cell.tested == 0.0:
        return "not tested"
    false = f"{cell.false:.2f}" if np.isfinite(cell.false) else "–"
    return f"{' / '.join(f'{share:.2f}' for share in cell.shares)} ({false})"


def _weakest(found: dict[tuple[Logger, float], Cell]) -> str:
    """Say from what strength on one, 9 and 100 profiles distinguish the two kinds at the usual setting."""
    sentences = []
    for hull in INTERVALS:
        reached = []
        for at, count in enumerate(COUNTS):
            enough = [found[Logger(hull, 1.0, 0.1), rms].shares[at] >= ENOUGH for rms in STRENGTHS]
            from_here = [rms for i, rms in enumerate(STRENGTHS) if all(enough[i:])]
            reached.append(f"{count} from {1000 * from_here[0]:g} mm/s on" if from_here else f"{count} at no strength")
        sentences.append(f"{hull}, 1 s and 0.1 degrees: {', '.join(reached)}")
    return f"Profiles that distinguish the two kinds in {ENOUGH:g} of pairs: {'; '.join(sentences)}."


def _rate(figures: Figures, kind: str, **chosen: float) -> str:
    """Number of the tested twins of a kind that the test rejects."""
    rows = [row for row in figures["rows"] if all(row[name] == value for name, value in chosen.items())]
    p = _values(rows, kind, "gaussianity_p_value")
    p = p[np.isfinite(p)]
    return f"{int((p <= LEVEL).sum())} of {len(p)} ({np.mean(p <= LEVEL):.3f})"


def power_figure(figures: Figures) -> Figure:
    """Draw the share of pairs distinguished by one profile over the gust's strength, one panel for each hull."""
    figure = new_figure((9.2, 4.2), 110)
    found = cells(figures)
    for place, (hull, intervals) in enumerate(INTERVALS.items()):
        axes = figure.add_subplot(1, len(INTERVALS), place + 1)
        for interval, colour in zip(intervals[::-1], ("#000000", "#0072B2", "#009E73", "#D55E00"), strict=False):
            for resolution, style in zip(RESOLUTIONS, ("--", "-"), strict=True):
                shares = [found[Logger(hull, interval, resolution), rms].shares[0] for rms in STRENGTHS]
                text = f"{interval:g} s, {resolution:g} degrees"
                axes.plot(
                    [1000 * rms for rms in STRENGTHS], shares, style, color=colour, marker="o", markersize=3, label=text
                )
        axes.axhline(ENOUGH, color="#999999", linewidth=0.7)
        axes.axhline(0.5, color="#999999", linewidth=0.7, linestyle=":")
        axes.set_xscale("log")
        axes.set_xticks([1000 * rms for rms in STRENGTHS], [f"{1000 * rms:g}" for rms in STRENGTHS])
        axes.minorticks_off()
        axes.set_ylim(0.0, 1.03)
        style_axes(axes)
        label(axes, hull, "gust (mm/s)", "share of pairs distinguished (1)")
        if place == 0:
            legend(axes)
    return figure
