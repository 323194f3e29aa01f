"""What a study of an archive is: what it is asked, what it leaves, and how that is shown.

A study is a module of this package with a module-level ``STUDY``; the registry names it. Its `run` reads an archive and
writes the archive's group of its name, with a `Provenance`; its `show` makes the findings from that group and from
nothing else, so that ``analyze`` and ``report`` give the same tables and figures by the same code.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import xarray as xr

from gliderhpc.analysis.archived import about_the_estimate, chosen_profiles, positions
from gliderhpc.analysis.comparison import Comparison, comparisons_as_json
from gliderhpc.analysis.files import as_plain
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.provenance import Provenance
from gliderhpc.mission.archive import open_for_reading
from gliderhpc.mission.executors import Executor
from gliderhpc.mission.profile_data import ADJOINT
from gliderhpc.mission.settings import parse_assignments
from gliderhpc.store_schema import (
    Place,
    create_study,
    finish_study,
    set_study_attributes,
    study_attributes,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Request:
    """What a study is asked to do.

    Attributes
    ----------
    archive : Path
        The finished mission.
    executor : callable
        Opens where jobs run.
    profiles : str, optional
        Which profiles, as ``18:20,68``; all that are done when None.
    quick : bool
        A size for a first look, under two minutes on two cores.
    estimate : str
        Whose disturbances and motion: of `gliderhpc.mission.profile_data.ESTIMATES`; `read_profile_data` gives them.
    observations, truth : Path, optional
        The mission's observation file, and a synthetic mission's truth.
    budget : Path, optional
        The current's uncertainty as ``twin recoverability`` found it for the platform.
    reference : Path, optional
        Currents that somebody else found for the same dives.
    assignments : tuple of str
        Settings of the study, as ``KEY=VALUE``.
    models : tuple of str
        Files, patterns of files and OPeNDAP addresses of ocean models.
    report : callable
        Called with the number of a profile when it is done.
    """

    archive: Path
    executor: Callable[[], AbstractContextManager[Executor]]
    profiles: str | None = None
    quick: bool = False
    estimate: str = ADJOINT
    observations: Path | None = None
    truth: Path | None = None
    budget: Path | None = None
    models: tuple[str, ...] = ()
    reference: Path | None = None
    assignments: tuple[str, ...] = ()
    report: Callable[[int], None] = lambda _: None

    @property
    def path(self) -> str:
        """The archive's place, for workers that start elsewhere."""
        return str(self.archive.resolve())


@dataclass(frozen=True)
class Chosen:
    """The profiles that a request is about.

    Attributes
    ----------
    numbers : tuple of int
        Which they are.
    where : mapping of int to int
        Position along the archive's profile dimension, by number, of all profiles.
    remarks : tuple of str
        What is to be minded of the estimate asked for.
    """

    numbers: tuple[int, ...]
    where: Mapping[int, int]
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class Shown:
    """A group that an archive may hold, and how it is shown.

    Attributes
    ----------
    name, title : str
        Of the group, and one line for people.
    show : callable
        Makes the findings from an archive that holds the group, as `gliderhpc.mission.archive.open_for_reading` opens
        it, and from nothing else.
    """

    name: str
    title: str
    show: Callable[[xr.DataTree], Findings]


@dataclass(frozen=True)
class Study(Shown):
    """A study: its name (that of its group and of its module), what it is, how it is shown, what it lacks, how it runs.

    Attributes
    ----------
    missing : callable
        Says which of its inputs a request lacks, None where nothing does.
    run : callable
        Does it, group and all, and shows it.
    """

    missing: Callable[[Request], str | None]
    run: Callable[[Request], Findings]


def nothing_missing(request: Request) -> str | None:
    """Say what a request lacks for a study that the archive alone makes: nothing."""
    return None


def choose(archive: xr.DataTree, request: Request) -> Chosen:
    """Choose the profiles of a request among an archive's.

    Raises
    ------
    InputError
        No such profile is done, or the archive has no such estimate.
    """
    numbers = chosen_profiles(archive, request.profiles, request.quick)
    return Chosen(numbers, positions(archive), about_the_estimate(archive, request.estimate, numbers))


def default_folder(archive: str | Path, study: str, estimate: str = ADJOINT) -> Path:
    """Where a study's files go unless told otherwise: ``ARCHIVE-studies/STUDY`` beside ``ARCHIVE.zarr``.

    Those of another estimate than the adjoint's go to ``STUDY-ESTIMATE``.
    """
    path = Path(archive)
    return path.with_name(f"{path.stem}-studies") / (study if estimate == ADJOINT else f"{study}-{estimate}")


def own_assignments(request: Request, name: str) -> dict[str, str]:
    """Settings given for a study, without its name: ``currents.bin=5`` is ``bin`` of the study ``currents``."""
    values, _ = parse_assignments(request.assignments)
    return {key.removeprefix(f"{name}."): text for key, text in values.items() if key.startswith(f"{name}.")}


def begin_study(
    request: Request,
    name: str,
    sizes: Mapping[str, int] | None = None,
    labels: Mapping[str, Sequence[str]] | None = None,
) -> tuple[str, ...]:
    """Make the archive's group of a study anew for the estimate asked for; says where it replaces another's.

    `sizes` are those of the study's own dimensions, `labels` the names along them where they have names.
    """
    before = study_attributes(request.archive, name).get("estimate", request.estimate)
    create_study(request.archive, name, sizes, attributes={"estimate": request.estimate}, labels=labels)
    if before == request.estimate:
        return ()
    return (f"the archive's group {name} held the study of the {before} estimate; this one replaces it",)


def provenance(
    request: Request,
    rows: Mapping[int, Mapping[str, Any]],
    settings: Mapping[str, Any] | None = None,
    remarks: Sequence[str] = (),
    beside: Sequence[str] = (),
) -> Provenance:
    """How a study was made: of a request, with the rows that it gave its table by number of profile.

    `beside` are the mission's columns that the study's table begins with.
    """
    columns = dict.fromkeys(("profile", *beside, *(name for row in rows.values() for name in row)))
    return Provenance(tuple(rows), tuple(columns), request.estimate, request.quick, settings or {}, tuple(remarks))


def conclude_study(archive: Place, study: Shown, made: Provenance, more: Mapping[str, Any] | None = None) -> Findings:
    """Close a study's group with how it was made, show it, and leave what was found among its attributes too.

    Parameters
    ----------
    archive : str or Path
        With the group filled.
    study : Shown
        Whose it is.
    made : Provenance
        How.
    more : mapping, optional
        Further attributes that showing it takes, anything that JSON holds.
    """
    finish_study(archive, study.name, as_plain({**made.attributes(), **(more or {})}))
    with open_for_reading(archive) as opened:
        findings = study.show(opened)
    found = {**findings.content["facts"], "comparisons": findings.content["comparisons"]}
    set_study_attributes(archive, study.name, as_plain(found))
    return findings


def archive_findings(
    study: str,
    comparisons: Sequence[Comparison],
    tables: Mapping[str, pd.DataFrame],
    figures: Mapping[str, Figure],
    facts: Mapping[str, Any],
    failed: Mapping[int, str],
    remarks: tuple[str, ...] = (),
    *,
    captions: Mapping[str, str],
) -> Findings:
    """Findings of a study of an archive: one table of comparisons, and a JSON that holds it beside the facts.

    Every figure and table needs its caption; captions of what is not there are left out.
    """
    return Findings(
        comparisons={study: comparisons},
        tables={stem: _rows(table) for stem, table in tables.items()},
        figures=figures,
        content={
            "comparisons": comparisons_as_json(comparisons), "facts": facts, "failed": failed, "remarks": remarks,
        },
        failed=failed,
        remarks=remarks,
        captions={stem: captions[stem] for stem in (*figures, *tables)},
    )  # fmt: skip


def _rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    return [{str(name): value for name, value in row.items()} for row in table.to_dict("records")]
