"""What a twin study is: its sizes, its runs, and how findings come of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from gliderhpc.errors import InputError
from gliderhpc.findings.comparison import Comparison, comparisons_as_json
from gliderhpc.findings.findings import Findings
from gliderhpc.mission.executors import Executor
from gliderhpc.platform import Platform
from gliderhpc.twins.runs import Report, Row, run_all, scored_row
from gliderhpc.version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class TwinSize:
    """How much is run; every study adds its own depths and sweeps.

    Attributes
    ----------
    seeds : int
        Twins a hull.
    """

    seeds: int


SizeT = TypeVar("SizeT", bound=TwinSize)


@dataclass(frozen=True)
class TwinPlan(Generic[SizeT]):
    """What a study is run on: hulls, size, seeds of the twins, and whether the size is that of a first look."""

    platforms: tuple[Platform, ...]
    size: SizeT
    seeds: tuple[int, ...]
    quick: bool


@dataclass(frozen=True)
class TwinStudy(Generic[SizeT]):
    """A twin study.

    Attributes
    ----------
    name : str
        The verb's argument, and the stem of its files.
    full, quick : TwinSize
        Its two sizes.
    runs : callable
        Lists every run of a plan: a `TwinRun`, or several that belong together.
    conclude : callable
        Makes findings of a plan and the runs' results, in the runs' order.
    job : callable
        What is done with a run, by a worker.
    least_seeds : int
        Twins that it needs.
    """

    name: str
    full: SizeT
    quick: SizeT
    runs: Callable[[TwinPlan[SizeT]], Sequence[Any]]
    conclude: Callable[[TwinPlan[SizeT], list[Any]], Findings]
    job: Callable[[Any], Any] = scored_row
    least_seeds: int = 1

    def plan(self, platforms: Sequence[Platform], *, quick: bool, seeds: int | None = None) -> TwinPlan[SizeT]:
        """Plan the study on some hulls, with seeds 1, 2, ...: as many as asked for, or the size's own number.

        Raises
        ------
        InputError
            Fewer twins were asked for than the study needs.
        """
        size = self.quick if quick else self.full
        count = size.seeds if seeds is None else seeds
        if count < self.least_seeds:
            raise InputError(f"--seeds {count}: twin {self.name} needs at least {self.least_seeds}")
        return TwinPlan(tuple(platforms), size, tuple(range(1, count + 1)), quick)

    def run(self, plan: TwinPlan[SizeT], executor: Executor, report: Report) -> Findings:
        """Run everything and conclude; `report` is told of every run that is done.

        Raises
        ------
        InputError
            What the twins gave makes no result.
        """
        return self.conclude(plan, run_all(self.runs(plan), executor, report, self.job))


def twin_findings(
    study: str,
    plan: TwinPlan[Any],
    comparisons: Mapping[str, Sequence[Comparison]],
    rows: Sequence[Row],
    figure: Figure,
    facts: Mapping[str, Any],
    documents: Mapping[str, str] | None = None,
    remarks: tuple[str, ...] = (),
) -> Findings:
    """Findings of a twin study: one CSV and one PNG of its name, and a JSON that also says what it came from."""
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
