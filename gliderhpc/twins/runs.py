"""Spreading a study's runs over workers: every run is a row, and rows come back in the order they were asked for."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from gliderhpc.errors import ProfileError
from gliderhpc.mission.executors import Executor
from gliderhpc.twins.inversion import TwinCase, invert_twin
from gliderhpc.twins.scoring import score

Row = dict[str, Any]
Report = Callable[[], None]


@dataclass(frozen=True)
class TwinRun:
    """One run of a study: the twin, and what the row calls it."""

    case: TwinCase
    labels: tuple[tuple[str, Any], ...]


def labelled(case: TwinCase, **labels: Any) -> TwinRun:
    """Make a run of a case with the row's labels."""
    return TwinRun(case, tuple(labels.items()))


def scored_row(run: TwinRun) -> Row:
    """Invert a twin and score it; a record that the pipeline refuses gives a row with the reason instead."""
    row: Row = {**dict(run.labels), "seed": run.case.seed, "number": run.case.number}
    try:
        return row | score(invert_twin(run.case))
    except ProfileError as error:
        return row | {"refused": str(error)}


def run_all(
    runs: Sequence[Any], executor: Executor, report: Report, function: Callable[[Any], Any] = scored_row
) -> list[Any]:
    """Run a function over runs and give its results in the runs' order, whatever worker was first.

    Parameters
    ----------
    runs : sequence
        Picklable jobs, seeded.
    executor : Executor
        Where they run.
    report : callable
        Told of every run that is done.
    function : callable
        At module level, so that workers can import it.
    """
    results: list[Any] = [None] * len(runs)
    for index, result in executor.run(partial(_numbered, function), list(enumerate(runs))):
        results[index] = result
        report()
    return results


def _numbered(function: Callable[[Any], Any], job: tuple[int, Any]) -> tuple[int, Any]:
    return job[0], function(job[1])
