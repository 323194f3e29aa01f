"""How well one profile tells an intermittent gust from a Gaussian one: by hull, logger, strength and number of profiles.

Every twin is simulated, filtered, smoothed and inverted with the default settings, and tested by the score of its
standardised noise (`gliderhpc.studies.library.turbulence.gaussianity`).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.turbulence_series import Figures
from gliderhpc import load_platform
from gliderhpc.errors import ProfileError
from gliderhpc.estimation.preparation import on_steps, prepare_profile
from gliderhpc.estimation.profile import estimate_profile
from gliderhpc.findings.drawing import dress, label, legend, new_figure
from gliderhpc.findings.findings import markdown
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

HULLS, INTERVALS, RESOLUTIONS = ("petrel-l", "slocum"), (0.1, 0.2, 0.5, 1.0, 2.0), (0.01, 0.1)
STRENGTHS, KINDS = (0.001, 0.004, 0.016, 0.064), ("cascade", "gaussian")
SEEDS, DEPTH = range(400, 410), 120.0
COUNTS = (1, 9, 100)
"""Numbers of profiles that are pooled."""

ENOUGH = 0.9
"""Share of pairs from which the two kinds are told apart."""

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
    twins = [
        Twin(Logger(*logger), strength, kind, seed)
        for *logger, strength, kind, seed in product(HULLS, INTERVALS, RESOLUTIONS, STRENGTHS, KINDS, SEEDS)
    ]
    with local_executor(workers) as executor:
        rows = []
        for row in executor.run(score_of, twins):
            rows.append(row)
            print(row, flush=True)
    return {"rows": rows}


class Cell(NamedTuple):
    """What the twins of a logger and strength show.

    Attributes
    ----------
    shares : (c,) array
        Shares of pairs in which the cascades' pooled score is the larger, by the numbers of profiles in `COUNTS`.
    detected, false : float
        Shares of the cascades, and of the Gaussian gusts, that one profile's test rejects at `LEVEL`.
    tested : float
        Share of the twins in which a channel is tested.
    """

    shares: Array
    detected: float
    false: float
    tested: float


def cell_of(rows: list[Figures]) -> Cell:
    """Summarise the twins of a logger and strength; twins that are not tested have no score to pool, which is zero."""
    scores, p = (
        {kind: np.array([row[name] for row in rows if row["kind"] == kind], dtype=np.float64) for kind in KINDS}
        for name in ("gaussianity_score", "gaussianity_p_value")
    )
    tested = float(np.mean([np.isfinite(values).mean() for values in scores.values()]))
    ours, theirs = (np.nan_to_num(scores[kind]) for kind in KINDS)
    single = np.mean((ours[:, None] > theirs) + 0.5 * (ours[:, None] == theirs))
    spread = float(np.sqrt(ours.var(ddof=1) + theirs.var(ddof=1)))
    distance = (ours.mean() - theirs.mean()) / spread if spread > 0.0 else 0.0
    pooled = [scipy.stats.norm.cdf(distance * np.sqrt(count)) for count in COUNTS[1:]]
    shares = np.array([single, *(max(single, share) if single > 0.5 else share for share in pooled)])
    return Cell(shares, float(np.mean(p["cascade"] <= LEVEL)), float(np.mean(p["gaussian"] <= LEVEL)), tested)


def cells(figures: Figures) -> Iterator[tuple[Logger, float, Cell]]:
    """Yield the cells of the table."""
    for *logger, strength in product(HULLS, INTERVALS, RESOLUTIONS, STRENGTHS):
        where = Logger(*logger)
        own = [
            row for row in figures["rows"]
            if (row["hull"], row["interval"], row["resolution"]) == where and row["strength"] == strength
        ]  # fmt: skip
        yield where, strength, cell_of(own)


def power_text(figures: Figures) -> str:
    """Table of the shares of pairs, and what it says to an operator."""
    columns = ("hull", "interval, s", "resolution, degrees", *(f"{1000 * rms:g} mm/s" for rms in STRENGTHS))
    found = {(logger, strength): cell for logger, strength, cell in cells(figures)}
    lines = []
    for logger in dict.fromkeys(logger for logger, _ in found):
        shares = [" / ".join(f"{share:.2f}" for share in found[logger, rms].shares) for rms in STRENGTHS]
        lines.append((logger.hull, f"{logger.interval:g}", f"{logger.resolution:g}", *shares))
    return (
        f"{markdown(columns, lines, columns[1:])}\n\n{_weakest(found)}\n\nIn Gaussian gusts the test of one profile rejects "
        f"{_rate(figures, 'gaussian')} at a level of {LEVEL:g}; in cascades it rejects {_rate(figures, 'cascade')}, and at "
        f"1 s and 0.1 degrees {_rate(figures, 'cascade', interval=1.0, resolution=0.1)}."
    )


def _weakest(found: dict[tuple[Logger, float], Cell]) -> str:
    """Say where one, 9 and 100 profiles tell the two kinds apart at the loggers' usual setting."""
    sentences = []
    for hull in HULLS:
        usual = Logger(hull, 1.0, 0.1)
        reached = []
        for at, count in enumerate(COUNTS):
            strong = [rms for rms in STRENGTHS if found[usual, rms].shares[at] >= ENOUGH]
            reached.append(f"{count} from {1000 * min(strong):g} mm/s on" if strong else f"{count} at no strength")
        sentences.append(f"{hull}, 1 s and 0.1 degrees: {', '.join(reached)}")
    return f"Profiles that tell the two kinds apart in {ENOUGH:g} of pairs: {'; '.join(sentences)}."


def _rate(figures: Figures, kind: str, **chosen: float) -> str:
    """Number of twins of a kind that the test rejects."""
    p = np.array(
        [
            row["gaussianity_p_value"]
            for row in figures["rows"]
            if row["kind"] == kind and all(row[name] == value for name, value in chosen.items())
        ],
        dtype=np.float64,
    )
    return f"{int((p <= LEVEL).sum())} of {len(p)} ({np.mean(p <= LEVEL):.3f})"


def power_figure(figures: Figures) -> Figure:
    """Draw the share of pairs told apart by one profile over the gust's strength, one panel for each hull."""
    figure = new_figure((9.2, 4.2), 110)
    found = {(logger, strength): cell for logger, strength, cell in cells(figures)}
    for place, hull in enumerate(HULLS):
        axes = figure.add_subplot(1, len(HULLS), place + 1)
        for interval, colour in zip(INTERVALS, ("#000000", "#0072B2", "#009E73", "#D55E00", "#CC79A7"), strict=True):
            for resolution, style in zip(RESOLUTIONS, ("--", "-"), strict=True):
                shares = [found[Logger(hull, interval, resolution), rms].shares[0] for rms in STRENGTHS]
                text = f"{interval:g} s, {resolution:g} degrees"
                axes.plot(
                    [1000 * rms for rms in STRENGTHS], shares, style, color=colour, marker="o", markersize=3, label=text
                )
        axes.axhline(ENOUGH, color="#999999", linewidth=0.7)
        axes.axhline(0.5, color="#999999", linewidth=0.7, linestyle=":")
        axes.set_xscale("log")
        axes.set_ylim(0.0, 1.03)
        dress(axes)
        label(axes, hull, "gust (mm/s)", "share of pairs told apart (1)")
        if place == 0:
            legend(axes)
    return figure
