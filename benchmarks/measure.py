"""Gradients, windows and whole profiles: every contender on the same ones, in turn."""

import statistics
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from benchmarks.engines import Engine
from benchmarks.peers.base import Answer, Contender, judge
from benchmarks.timing import groups_of, in_turns, ratios_to, seconds_of, spread_of
from benchmarks.windows import Window
from gliderhpc import Glider
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.observations import ProfileSeries

Row = dict[str, Any]


def gradient_rows(
    contenders: Sequence[Contender], windows: Sequence[Window], repetitions: int, reference: str
) -> dict[str, Row]:
    """Seconds of one window's cost and gradient, each contender on as many windows as it takes at a time."""
    calls = {contender.name: _gradient_call(contender, windows) for contender in contenders}
    shares = {contender.name: min(contender.batch, len(windows)) for contender in contenders}
    times = in_turns(calls, repetitions)
    spreads = {name: spread_of([second / shares[name] for second in seconds]) for name, seconds in times.items()}
    ratios = ratios_to(reference, {name: spread.median for name, spread in spreads.items()})
    return {name: {**spread.row(), "ratio": ratios[name]} for name, spread in spreads.items()}


def window_rows(
    contenders: Sequence[Contender],
    windows: Sequence[Window],
    settings: EstimationSettings,
    repetitions: int,
    reference: str,
) -> dict[str, Row]:
    """Seconds a window from start to answer, and what the answers are worth under the project's own measure.

    A window's time is its median over the repetitions; the spread is over the windows. The ratio is of the means over the
    windows: an engine that takes many at a time has no other, and hard windows cost every engine more.
    """
    seconds, answers = _solve_in_turns(contenders, windows, repetitions)
    typical = {name: [statistics.median(s) for s in times] for name, times in seconds.items()}
    means = {name: statistics.fmean(times) for name, times in typical.items()}
    ratios = ratios_to(reference, means)
    return {
        name: {
            **spread_of(times).row(),
            "mean": means[name],
            "ratio": ratios[name],
            **worth(windows, answers[name], settings),
        }
        for name, times in typical.items()
    }


def worth(windows: Sequence[Window], answers: Sequence[Answer], settings: EstimationSettings) -> Row:
    """Iterations, evaluations, outcomes, final cost and optimality of one contender's answers."""
    verdicts = [judge(window, answer, settings) for window, answer in zip(windows, answers, strict=True)]
    outcomes = Counter(verdict.outcome.name.lower() for verdict in verdicts)
    return {
        "iterations": statistics.median(answer.iterations for answer in answers),
        "evaluations": statistics.median(answer.evaluations for answer in answers),
        "outcomes": dict(outcomes),
        "cost": statistics.median(verdict.cost for verdict in verdicts),
        "gradient_norm": max(verdict.gradient_norm for verdict in verdicts),
    }


def profile_rows(
    engines: Mapping[str, Engine], glider: Glider, series: ProfileSeries, repetitions: int
) -> dict[str, Row]:
    """Seconds a profile of each engine, from its record on the steps to its disturbances."""
    times = in_turns(profile_calls(engines, glider, series), repetitions)
    return {
        name: spread_of([second / engines[name].at_a_time for second in seconds]).row()
        for name, seconds in times.items()
    }


def profile_calls(
    engines: Mapping[str, Engine], glider: Glider, series: ProfileSeries
) -> dict[str, Callable[[], object]]:
    """Each engine's call on as many copies of a profile as it takes at a time."""
    return {
        name: lambda e=engine: e.estimate(glider, [series] * e.at_a_time)  # type: ignore[misc]
        for name, engine in engines.items()
    }


def described(contender: Contender, difference: float) -> Row:
    """Describe a contender, in addition to its times."""
    return {
        "label": contender.label,
        "settings": dict(contender.settings),
        "versions": dict(contender.versions),
        "batch": contender.batch,
        "largest_relative_difference": difference,
    }


def _gradient_call(contender: Contender, windows: Sequence[Window]) -> Callable[[], object]:
    chosen = windows[: contender.batch]
    if contender.gradient is not None:
        return contender.gradient(chosen)
    evaluate, points = contender.prepare(chosen), [window.unknown for window in chosen]
    return lambda: evaluate(points)


def _solve_in_turns(
    contenders: Sequence[Contender], windows: Sequence[Window], repetitions: int
) -> tuple[dict[str, list[list[float]]], dict[str, list[Answer]]]:
    """Seconds by contender, window and repetition, and the answers: a stretch of windows by each in turn, repeated."""
    seconds: dict[str, list[list[float]]] = {c.name: [[] for _ in windows] for c in contenders}
    answers: dict[str, list[Answer]] = {}
    for contender in contenders:
        answers[contender.name] = _answers(contender, windows)
    for stretch in groups_of(len(windows), max(contender.batch for contender in contenders)):
        for _ in range(repetitions):
            for contender in contenders:
                for group in groups_of(len(stretch), contender.batch):
                    numbers = [stretch[i] for i in group]
                    chosen = [windows[i] for i in numbers]
                    took = seconds_of(lambda c=contender, w=chosen: c.solve(w)) / len(numbers)
                    for i in numbers:
                        seconds[contender.name][i].append(took)
    return seconds, answers


def _answers(contender: Contender, windows: Sequence[Window]) -> list[Answer]:
    """Every window's answer; the run that warms caches and compilers."""
    groups = groups_of(len(windows), contender.batch)
    return [answer for group in groups for answer in contender.solve([windows[i] for i in group])]
