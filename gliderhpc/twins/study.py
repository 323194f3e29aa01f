"""Engine of the twin experiments: runs distributed over workers, their rows in one tidy table, findings and figures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.findings.comparison import Comparison, comparisons_as_json
from gliderhpc.findings.results import Findings
from gliderhpc.mission.executors import Executor
from gliderhpc.platform import Platform
from gliderhpc.twins.cases import TwinCase
from gliderhpc.twins.inversion import invert_twin
from gliderhpc.twins.scoring import Row, score
from gliderhpc.version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Report = Callable[[], None]


@dataclass(frozen=True)
class TwinRun:
    """One run of a study: the twin, and the labels of its row."""

    case: TwinCase
    labels: tuple[tuple[str, Any], ...]


@dataclass(frozen=True, kw_only=True)
class TwinSize:
    """Size of a study; every study adds its own depths and sweeps.

    Attributes
    ----------
    seeds : int
        Number of twins per hull.
    """

    seeds: int


SizeT = TypeVar("SizeT", bound=TwinSize)


@dataclass(frozen=True)
class TwinPlan(Generic[SizeT]):
    """Hulls, size and seeds of a study, and whether the size is that of a first look."""

    platforms: tuple[Platform, ...]
    size: SizeT
    seeds: tuple[int, ...]
    quick: bool


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


@dataclass(frozen=True)
class TwinStudy(Generic[SizeT]):
    """A twin study.

    Attributes
    ----------
    name : str
        Argument of ``gliderhpc twin``, and stem of the study's files.
    full, quick : TwinSize
        Full size, and size of a first look.
    runs : callable
        Function that lists every run of a plan: a `TwinRun`, or several that belong together.
    conclude : callable
        Function that makes findings from a plan and the rows of all runs, in the order of the runs.
    job : callable
        Function that makes the row or rows of a run in a worker; it must be importable, at module level.
    min_seeds : int
        Smallest number of twins.
    """

    name: str
    full: SizeT
    quick: SizeT
    runs: Callable[[TwinPlan[SizeT]], Sequence[Any]]
    conclude: Callable[[TwinPlan[SizeT], list[Row]], Findings]
    job: Callable[[Any], Row | list[Row]] = scored_row
    min_seeds: int = 1

    def plan(self, platforms: Sequence[Platform], *, quick: bool, seeds: int | None = None) -> TwinPlan[SizeT]:
        """Plan the study for some hulls, with seeds 1, 2, ...: as many as requested, or the size's own number.

        Raises
        ------
        InputError
            Fewer twins were requested than the study needs.
        """
        size = self.quick if quick else self.full
        count = size.seeds if seeds is None else seeds
        if count < self.min_seeds:
            raise InputError(f"`seeds={count}`: twin {self.name} needs at least {self.min_seeds}")
        return TwinPlan(tuple(platforms), size, tuple(range(1, count + 1)), quick)

    def run(self, plan: TwinPlan[SizeT], executor: Executor, advance: Report) -> Findings:
        """Run everything and conclude; `advance` is called after every run.

        Raises
        ------
        InputError
            The twins give no result.
        """
        return self.conclude(plan, all_rows(run_all(self.runs(plan), executor, advance, self.job)))


def run_all(
    runs: Sequence[Any], executor: Executor, advance: Report, function: Callable[[Any], Any] = scored_row
) -> list[Any]:
    """Apply a function to runs on an executor and return its results in the runs' order.

    Parameters
    ----------
    runs : sequence
        Picklable jobs with seeds.
    executor : Executor
        Executor with the workers.
    advance : callable
        Function called after every run.
    function : callable
        Function to apply; it must be importable by workers, at module level.
    """
    results: list[Any] = [None] * len(runs)
    for index, result in executor.run(partial(_run_numbered, function), list(enumerate(runs))):
        results[index] = result
        advance()
    return results


def all_rows(results: Sequence[Row | list[Row]]) -> list[Row]:
    """Join the rows of all runs, one or several per run."""
    return [row for result in results for row in (result if isinstance(result, list) else [result])]


def tidy_table(rows: Sequence[Row]) -> pd.DataFrame:
    """Return rows as a table, one line per row, with a column ``refused`` even if no twin was refused."""
    table = pd.DataFrame(rows)
    return table if "refused" in table else table.assign(refused=None)


def groups(table: pd.DataFrame, by: Sequence[str], *, sort: bool = False) -> Iterator[tuple[Row, pd.DataFrame]]:
    """Yield the labels and the rows of every group of a table."""
    for labels, group in table.groupby(list(by), sort=sort):
        yield dict(zip(by, labels, strict=True)), group


def finite(group: pd.DataFrame, name: str) -> Array:
    """Finite values of a column."""
    values = group[name].to_numpy(dtype=np.float64)
    return np.asarray(values[np.isfinite(values)])


def select(rows: Sequence[Row], **labels: Any) -> list[Row]:
    """Rows with these labels."""
    return [row for row in rows if all(row.get(name) == value for name, value in labels.items())]


def first(rows: Sequence[Row], **labels: Any) -> Row:
    """First row with these labels; empty if there is none."""
    return next(iter(select(rows, **labels)), {})


def quartiles(name: str, values: Array) -> Row:
    """Median, lower and upper quartile as ``name``, ``name_low`` and ``name_high``; NaN without values."""
    ends = np.percentile(values, (50.0, 25.0, 75.0)).tolist() if values.size else [float("nan")] * 3
    return dict(zip((name, f"{name}_low", f"{name}_high"), ends, strict=True))


def twin_findings(
    study: str,
    plan: TwinPlan[Any],
    comparisons: Mapping[str, Sequence[Comparison]],
    *,
    rows: Sequence[Row],
    figure: Figure,
    facts: Mapping[str, Any],
    documents: Mapping[str, str] | None = None,
    remarks: tuple[str, ...] = (),
) -> Findings:
    """Findings of a twin study: a CSV and a PNG with its name, and a JSON with its plan, comparisons and facts."""
    content = {
        "study": study,
        "version": __version__,
        "quick": plan.quick,
        "platforms": [platform.name for platform in plan.platforms],
        "seeds": list(plan.seeds),
        "size": asdict(plan.size),
        "comparisons": {title: comparisons_as_json(table) for title, table in comparisons.items()},
        **facts,
    }
    return Findings(comparisons, {study: rows}, {study: figure}, content, documents or {}, remarks=remarks)


def _run_numbered(function: Callable[[Any], Any], job: tuple[int, Any]) -> tuple[int, Any]:
    return job[0], function(job[1])
