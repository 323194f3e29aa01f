"""The engine of the studies: requests, choice of profiles, jobs, the group's begin and end, provenance.

A study is a module or package of `gliderhpc.studies` with a module-level ``STUDY``; the registry names it. Some are one
function of a profile's data (`Study.profile`); the engine chooses profiles, runs them in lots on workers, writes their
values where the group's schema has them, and records settings and provenance. The others bring their own ``run``.
Tables and figures are made from the group alone, by `gliderhpc.report.studies`, so ``analyze`` and ``report`` agree.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import ADJOINT, ProfileData, read_profile_data
from gliderhpc.errors import ProfileError
from gliderhpc.estimation.settings import Settings
from gliderhpc.findings.tables import as_plain
from gliderhpc.mission.executors import Executor
from gliderhpc.mission.settings import build_settings_of, parse_assignments
from gliderhpc.platform import Platform
from gliderhpc.store_schema import (
    Place,
    create_study,
    finish_study,
    study_attributes,
)
from gliderhpc.store_schema.schema import PROFILE
from gliderhpc.store_schema.studies import study_called
from gliderhpc.studies.archived import chosen_profiles, estimate_remarks, platform_of, positions
from gliderhpc.studies.profile_jobs import StudiedProfile, study_profiles
from gliderhpc.studies.provenance import Provenance

Row = Mapping[str, Any]
"""Values by name of the group's variable."""

ESTIMATE_UNUSED = "no estimate enters this study, so --estimate changes nothing"


@dataclass(frozen=True)
class Request:
    """A study to run on an archive.

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
        Independent currents for the same dives.
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


def nothing_missing(request: Request) -> str | None:
    """Return None: the archive is the study's only input."""
    return None


@dataclass(frozen=True, eq=False)
class ProfileContext:
    """Inputs of a profile's study besides the profile's data.

    Attributes
    ----------
    archive : xarray.DataTree
        The mission.
    settings : Settings or None
        Of the study.
    inputs : object
        As `Preparation.inputs`.
    """

    archive: xr.DataTree
    settings: Any
    inputs: Any

    @property
    def platform(self) -> Platform:
        """The hull that the mission was estimated with."""
        return platform_of(self.archive)


@dataclass(frozen=True, eq=False)
class Preparation:
    """Findings of a study before its profiles are studied.

    Attributes
    ----------
    inputs : object
        Passed to every profile's job; must be picklable.
    sizes, labels : mapping
        Of the group's own dimensions: sizes, and the names along those that have names.
    attributes : mapping
        Further attributes of the group, for its tables and figures.
    remarks : tuple of str
        On the inputs, for the study's reader.
    """

    inputs: Any = None
    sizes: Mapping[str, int] = field(default_factory=dict)
    labels: Mapping[str, Sequence[str]] = field(default_factory=dict)
    attributes: Mapping[str, Any] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()


def prepare_nothing(request: Request, archive: xr.DataTree, numbers: tuple[int, ...], settings: Any) -> Preparation:
    """Return an empty preparation."""
    return Preparation()


ProfileFunction = Callable[[ProfileData, ProfileContext], Row]
PrepareFunction = Callable[[Request, xr.DataTree, tuple[int, ...], Any], Preparation]


class Study:
    """A study of an archive: a function of a profile, or a run of its own.

    Parameters
    ----------
    name, title : str
        Name of the study, of its group and of its module, and one line for people.
    missing : callable
        Names the input that a request lacks; None where nothing is missing.
    run : callable, optional
        Fills the archive's group of the study's name, for a study that is no loop over profiles.
    profile : callable, optional
        ``(ProfileData, ProfileContext) -> values`` by name of the group's variable; runs in a worker, for every chosen
        profile. A `ProfileError` becomes the profile's ``message``.
    settings : type, optional
        Frozen model of the study's settings.
    prepare : callable
        ``(Request, archive, numbers, settings) -> Preparation``, once before the profiles.
    check : callable, optional
        ``(Request, rows by number)``, once after them; may raise `InputError`.
    quick_settings : mapping
        Settings of a first look.
    mission_columns : tuple of str
        Columns of the mission's table with which the study's begins.
    uses_estimate : bool
        Whether the estimate asked for matters; otherwise profiles have the adjoint's.
    takes_settings : bool
        Whether the study has settings; otherwise any given is refused.

    Raises
    ------
    TypeError
        It has neither a function of a profile nor a run of its own, or both.
    """

    def __init__(
        self,
        name: str,
        title: str,
        missing: Callable[[Request], str | None] = nothing_missing,
        run: Callable[[Request], None] | None = None,
        *,
        profile: ProfileFunction | None = None,
        settings: type[Settings] | None = None,
        prepare: PrepareFunction = prepare_nothing,
        check: Callable[[Request, Mapping[int, Row]], None] | None = None,
        quick_settings: Mapping[str, Any] | None = None,
        mission_columns: tuple[str, ...] = (),
        uses_estimate: bool = True,
        takes_settings: bool = True,
    ) -> None:
        self.name, self.title, self.missing = name, title, missing
        self.settings, self.prepare, self.check = settings, prepare, check
        self.quick_settings = quick_settings or {}
        self.mission_columns, self.uses_estimate = mission_columns, uses_estimate
        self.takes_settings = takes_settings
        self.run: Callable[[Request], None]
        if run is not None and profile is None:
            self.run = run
        elif profile is not None and run is None:
            self.run = partial(run_by_profile, self, profile)
        else:
            raise TypeError(f"study {name}: give either a function of a profile or a run")

    def settings_for(self, request: Request) -> Settings | None:
        """Build the settings of a request.

        Raises
        ------
        InputError
            A setting is wrong.
        """
        if self.settings is None:
            return None
        base = self.quick_settings if request.quick else {}
        return build_settings_of(self.settings, base, own_assignments(request, self.name))


@dataclass(frozen=True)
class ProfileJob:
    """One profile to study."""

    number: int
    index: int
    estimate: str
    study: str
    profile: ProfileFunction
    settings: Settings | None
    inputs: Any


def run_by_profile(study: Study, profile: ProfileFunction, request: Request) -> None:
    """Study each chosen profile by itself and fill the archive's group of the study.

    Raises
    ------
    InputError
        No such profile is done, the archive has no such estimate, or a setting or another input is wrong.
    """
    settings = study.settings_for(request)
    with open_for_reading(request.archive) as archive:
        chosen = choose(archive, request, uses_estimate=study.uses_estimate)
        prepared = study.prepare(request, archive, chosen.numbers, settings)
    remarks = prepared.remarks + chosen.remarks + begin_study(request, study.name, prepared.sizes, prepared.labels)
    estimate = request.estimate if study.uses_estimate else ADJOINT
    if request.estimate != estimate:
        remarks += (ESTIMATE_UNUSED,)
    jobs = [
        ProfileJob(number, chosen.where[number], estimate, study.name, profile, settings, prepared.inputs)
        for number in chosen.numbers
    ]
    rows = {result.number: result.row for result in study_profiles(request, study.name, study_profile, jobs)}
    if study.check is not None:
        study.check(request, rows)
    columns = {number: _table_columns(study.name, row) for number, row in rows.items()}
    used = None if settings is None else settings.model_dump(mode="json")
    made = provenance(request, columns, used, remarks, study.mission_columns)
    finish_study_group(request.archive, study.name, made, prepared.attributes)


def study_profile(archive: xr.DataTree, job: ProfileJob) -> StudiedProfile:
    """Study one profile, and separate rows that the worker writes from values of the table; the job of a worker."""
    data = read_profile_data(archive, job.number, job.estimate)
    try:
        values = job.profile(data, ProfileContext(archive, job.settings, job.inputs))
    except ProfileError as error:
        values = {"message": str(error)}
    group = study_called(job.study)
    of_table = {name: value for name, value in values.items() if group[name].is_table}
    of_profile = {name: value for name, value in values.items() if name not in of_table}
    return StudiedProfile(job.number, job.index, of_table, rows=of_profile)


def _table_columns(name: str, row: Row) -> Row:
    """Values that a row has one of, which are the columns of the study's table."""
    group = study_called(name)
    return {column: value for column, value in row.items() if group[column].dims == (PROFILE,)}


@dataclass(frozen=True)
class Chosen:
    """The profiles of a request.

    Attributes
    ----------
    numbers : tuple of int
        Their numbers.
    where : mapping of int to int
        Position along the archive's profile dimension, by number, of all profiles.
    remarks : tuple of str
        On the estimate asked for.
    """

    numbers: tuple[int, ...]
    where: Mapping[int, int]
    remarks: tuple[str, ...]


def choose(archive: xr.DataTree, request: Request, *, uses_estimate: bool = True) -> Chosen:
    """Choose the profiles of a request among an archive's.

    Raises
    ------
    InputError
        No such profile is done, or the archive has no such estimate.
    """
    numbers = chosen_profiles(archive, request.profiles, request.quick)
    remarks = estimate_remarks(archive, request.estimate, numbers) if uses_estimate else ()
    return Chosen(numbers, positions(archive), remarks)


def default_folder(archive: str | Path, study: str, estimate: str = ADJOINT) -> Path:
    """Return the default folder of a study's files: ``ARCHIVE-studies/STUDY`` next to ``ARCHIVE.zarr``.

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
    """Create or replace the archive's group of a study; returns a remark where it held that of another estimate.

    `sizes` are those of the study's own dimensions, `labels` the names along them where they have names.
    """
    before = study_attributes(request.archive, name).get("estimate", request.estimate)
    create_study(request.archive, name, sizes, attributes={"estimate": request.estimate}, labels=labels)
    if before == request.estimate:
        return ()
    return (f"the archive's group {name} held the study of the {before} estimate; this one replaces it",)


def provenance(
    request: Request,
    rows: Mapping[int, Row],
    settings: Mapping[str, Any] | None = None,
    remarks: Sequence[str] = (),
    mission_columns: Sequence[str] = (),
) -> Provenance:
    """Provenance of a study: of a request, and the rows of its table by number of profile.

    `mission_columns` are those of the mission's table with which the study's begins.
    """
    columns = dict.fromkeys(("profile", *mission_columns, *(name for row in rows.values() for name in row)))
    return Provenance(tuple(rows), tuple(columns), request.estimate, request.quick, settings or {}, tuple(remarks))


def finish_study_group(archive: Place, name: str, made: Provenance, more: Mapping[str, Any] | None = None) -> None:
    """Mark a study's group complete, with its provenance.

    Parameters
    ----------
    archive : str or Path
        With the group filled.
    name : str
        Of the study.
    made : Provenance
        Profiles, columns, settings and remarks.
    more : mapping, optional
        Further attributes that its tables and figures need, anything that JSON holds.
    """
    finish_study(archive, name, as_plain({**made.attributes(), **(more or {})}))
