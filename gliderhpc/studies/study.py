"""What a study of an archive is asked, and what it leaves in the archive.

A study is a package of this one with a module-level ``STUDY``; the registry names it. Its `run` reads an archive and
writes the archive's group of its name, with a `Provenance`. Its tables and figures are made from that group and from
nothing else, by `gliderhpc.report.studies`, so that ``analyze`` and ``report`` give the same by the same code.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from gliderhpc.archive.profile import ADJOINT
from gliderhpc.findings.files import as_plain
from gliderhpc.mission.executors import Executor
from gliderhpc.mission.settings import parse_assignments
from gliderhpc.store_schema import (
    Place,
    create_study,
    finish_study,
    study_attributes,
)
from gliderhpc.studies.archived import about_the_estimate, chosen_profiles, positions
from gliderhpc.studies.provenance import Provenance

if TYPE_CHECKING:
    pass


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
        Whose disturbances and motion: of `gliderhpc.archive.profile.ESTIMATES`; `read_profile_data` gives them.
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
class Study:
    """A study of an archive.

    Attributes
    ----------
    name, title : str
        Name of the study, of its group and of its package, and one line for people.
    missing : callable
        Says which of its inputs a request lacks, None where nothing does.
    run : callable
        Fills the archive's group of its name.
    """

    name: str
    title: str
    missing: Callable[[Request], str | None]
    run: Callable[[Request], None]


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


def finish_study_group(archive: Place, name: str, made: Provenance, more: Mapping[str, Any] | None = None) -> None:
    """Mark a study's group complete, with how it was made.

    Parameters
    ----------
    archive : str or Path
        With the group filled.
    name : str
        Of the study.
    made : Provenance
        How it was made.
    more : mapping, optional
        Further attributes that its tables and figures need, anything that JSON holds.
    """
    finish_study(archive, name, as_plain({**made.attributes(), **(more or {})}))
