"""Engine of the studies: choice of profiles, jobs, creation and completion of the group, provenance.

A study is a module or package of `gliderhpc.studies` with a module-level ``STUDY``, listed in the registry. It consists
of a function of a profile's data (`Study.profile`), a function of the mission (`Study.mission`), or both. The engine
chooses profiles, studies them in runs on workers, writes the values into the study's group, and records settings and
provenance. `gliderhpc.report.studies` makes tables and figures from the group alone, so ``analyze`` and ``report``
agree.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import partial
from typing import Any

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import ADJOINT, ProfileData, read_profile_data
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import ProfileError
from gliderhpc.estimation.settings import Settings
from gliderhpc.findings.results import as_plain
from gliderhpc.platform import Platform
from gliderhpc.store_schema import (
    Digests,
    create_study,
    finish_study,
    study_attributes,
    write_manifests,
    write_table_rows,
    write_whole,
)
from gliderhpc.store_schema.schema import PROFILE, study_called
from gliderhpc.studies.archived import (
    Provenance,
    chosen_among,
    chosen_profiles,
    estimate_remarks,
    platform_of,
    positions,
)
from gliderhpc.studies.profile_jobs import OpenInputs, StudiedProfile, run_jobs
from gliderhpc.studies.request import Request, study_settings

Row = Mapping[str, Any]
"""Values by name of the group's variables."""

ESTIMATE_UNUSED = "this study uses no estimate; `estimate` has no effect"


@dataclass(frozen=True, eq=False)
class ProfileContext:
    """Inputs of a profile's study in addition to the profile's data.

    Attributes
    ----------
    number : int
        Number of the profile.
    archive : Archive
        Archive of the mission.
    settings : Settings or None
        Settings of the study.
    inputs : object
        `Preparation.inputs` as opened by `Study.opened`.
    """

    number: int
    archive: Archive
    settings: Any
    inputs: Any

    @property
    def platform(self) -> Platform:
        """Hull that the mission was estimated with."""
        return platform_of(self.archive)


@dataclass(frozen=True, eq=False, kw_only=True)
class GroupContent:
    """Content of a study's group that belongs to no single profile.

    Attributes
    ----------
    sizes, labels : mapping
        Sizes of the group's own dimensions, and the names along those that have names.
    variables : mapping of str to array_like
        Values of the variables without a profile dimension.
    attributes : mapping
        Further attributes of the group, for its tables and figures.
    remarks : tuple of str
        Remarks for the reader of the study.
    columns : tuple of str, optional
        Columns of the study's table, if they differ from those of the profiles' rows.
    rows : mapping of int to mapping
        Further values of the profiles' rows, by number.
    """

    sizes: Mapping[str, int] = field(default_factory=dict)
    labels: Mapping[str, Sequence[str]] = field(default_factory=dict)
    variables: Mapping[str, Any] = field(default_factory=dict)
    attributes: Mapping[str, Any] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    columns: tuple[str, ...] | None = None
    rows: Mapping[int, Row] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, kw_only=True)
class Preparation(GroupContent):
    """Inputs and content that a study determines before its profiles are studied.

    Attributes
    ----------
    inputs : object
        Inputs passed to every profile's function; must be picklable.
    numbers : tuple of int, optional
        Profiles to study, if they differ from those of the request.
    caveats : tuple of str
        Remarks that follow those on the estimate.
    """

    inputs: Any = None
    numbers: tuple[int, ...] | None = None
    caveats: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Plan:
    """A request with its settings, profiles and inputs.

    Attributes
    ----------
    request : Request
        The request.
    settings : Settings or None
        Settings of the study.
    numbers : tuple of int
        Numbers of the profiles to study.
    positions : mapping of int to int
        Positions of all profiles along the archive's profile dimension, by number.
    prepared : Preparation
        Inputs and content determined beforehand.
    remarks : tuple of str
        Remarks on the inputs and the estimate.
    """

    request: Request
    settings: Any
    numbers: tuple[int, ...]
    positions: Mapping[int, int]
    prepared: Preparation
    remarks: tuple[str, ...]


ProfileFunction = Callable[[ProfileData, ProfileContext], Row]
ReadFunction = Callable[[Archive, int], Any]
MissionFunction = Callable[[Plan, Mapping[int, Row]], GroupContent]
PrepareFunction = Callable[[Request, Archive, tuple[int, ...], Any], Preparation]


@dataclass(frozen=True, eq=False)
class Study:
    """A study of an archive: a function of a profile, a function of the mission, or both.

    Parameters
    ----------
    name, title : str
        Name of the study, its group and its module, and a title of one line.
    profile : callable, optional
        ``(ProfileData, ProfileContext) -> values`` by name of the group's variables; runs in a worker, for every chosen
        profile. A `ProfileError` becomes the profile's ``message``.
    mission : callable, optional
        ``(Plan, rows by number) -> GroupContent``, called once after the profiles. The group is created after this
        call, which may determine the sizes of dimensions. In such a study `profile` may return further values for this
        function, under names that the group lacks, but no values in chunks of their own.
    settings : type or callable, optional
        Frozen model of the study's settings, or a function of the request that builds them; without it a study accepts
        no settings.
    quick_settings : mapping
        Settings of a first look, if `settings` is a model.
    missing : callable
        ``(Request, settings) -> str or None``: description of the input that a request lacks, None if nothing is
        missing.
    prepare : callable
        ``(Request, archive, numbers, settings) -> Preparation``, called once before the profiles.
    opened : callable
        Context manager that opens `Preparation.inputs`, once for each run of profiles in a worker.
    check : callable, optional
        ``(Request, rows by number)``, called once after the profiles; may raise `InputError`.
    mission_columns : tuple of str
        Columns of the mission's table that come first in the study's table.
    wide_dims : tuple of str
        Dimensions of variables that are columns of the table although they have several values for each profile.
    estimate_unused : str
        Remark that the requested estimate has no effect, as the adjoint's is always used; empty if it has an effect.
    """

    name: str
    title: str
    _: KW_ONLY
    profile: ProfileFunction | None = None
    mission: MissionFunction | None = None
    settings: type[Settings] | Callable[[Request], Settings] | None = None
    quick_settings: Mapping[str, Any] = field(default_factory=dict)
    missing: Callable[[Request, Any], str | None] = lambda *_: None
    prepare: PrepareFunction = lambda *_: Preparation()
    opened: OpenInputs = nullcontext
    check: Callable[[Request, Mapping[int, Row]], None] | None = None
    mission_columns: tuple[str, ...] = ()
    wide_dims: tuple[str, ...] = ()
    estimate_unused: str = ""

    def settings_for(self, request: Request) -> Any:
        """Build the settings of a request.

        Raises
        ------
        InputError
            A setting is wrong.
        """
        if not isinstance(self.settings, type):
            return None if self.settings is None else self.settings(request)
        return study_settings(request, self.name, self.settings, self.quick_settings if request.quick else {})

    def run(self, request: Request, settings: Any) -> None:
        """Study the chosen profiles and the mission, and fill the study's group in the archive.

        Parameters
        ----------
        request : Request
            The request.
        settings : Settings or None
            Its settings, from `settings_for`.

        Raises
        ------
        InputError
            No such profile is done, the archive has no such estimate, or another input is wrong.
        """
        plan = self.plan(request, settings)
        content = GroupContent()
        begun = _begin(request, self.name, plan.prepared) if self.mission is None else ()
        rows, digests = self.study_profiles(plan)
        if self.check is not None:
            self.check(request, rows)
        if self.mission is not None:
            content = self.mission(plan, rows)
            begun = _begin(request, self.name, content)
            rows = _table_rows(self.name, rows, content.rows)
        write_table_rows(request.archive, {plan.positions[number]: row for number, row in rows.items()}, self.name)
        write_manifests(request.archive, self.name, digests)
        write_whole(request.archive, self.name, {**plan.prepared.variables, **content.variables})
        unused = (self.estimate_unused,) if self.estimate_unused and request.estimate != ADJOINT else ()
        provenance = Provenance(
            plan.numbers if self.profile is None else tuple(rows),
            self._columns(rows) if content.columns is None else content.columns,
            request.estimate,
            request.quick,
            {} if plan.settings is None else plan.settings.model_dump(mode="json"),
            plan.remarks + begun + unused + content.remarks,
        )
        own = self.own_attributes(request)
        attributes = {**provenance.attributes(), **own, **plan.prepared.attributes, **content.attributes}
        finish_study(request.archive, self.name, as_plain(attributes))

    def plan(self, request: Request, settings: Any) -> Plan:
        """Choose the profiles of a request, and prepare their study.

        Raises
        ------
        InputError
            No such profile is done, the archive has no such estimate, or another input is wrong.
        """
        with open_for_reading(request.archive) as archive:
            numbers = self.choose(archive, request.profiles, request.quick)
            remarks = () if self.estimate_unused else estimate_remarks(archive, request.estimate, numbers)
            prepared = self.prepare(request, archive, numbers, settings)
            if prepared.numbers is not None:
                numbers = prepared.numbers
            remarks = prepared.remarks + remarks + prepared.caveats
            return Plan(request, settings, numbers, positions(archive), prepared, remarks)

    def study_profiles(self, plan: Plan) -> tuple[dict[int, Row], dict[int, Digests]]:
        """Study the profiles of a plan on workers, which write the rows of their own chunks.

        Returns
        -------
        rows : dict of int to mapping
            Values not written by the workers, by profile number.
        digests : dict of int to mapping
            Digests of the chunks that the workers wrote, by position of the profile.
        """
        if self.profile is None:
            return {}, {}
        study = ProfileJob(self.name, self.profile, self.reader(plan.request), plan.settings)
        jobs = [(number, plan.positions[number]) for number in plan.numbers]
        results, digests = run_jobs(plan.request, self.name, study, jobs, plan.prepared.inputs, self.opened)
        return {result.number: result.table_row for result in results}, digests

    def choose(self, archive: Archive, text: str | None, quick: bool) -> tuple[int, ...]:
        """Choose among the profiles that can be studied; a quick study uses the first few.

        Raises
        ------
        InputError
            No profile can be studied, or the text names one that cannot.
        """
        return chosen_profiles(archive, text, quick)

    def reader(self, request: Request) -> ReadFunction:
        """Return the function that reads a profile's data in a worker."""
        return partial(read_profile_data, estimate=ADJOINT if self.estimate_unused else request.estimate)

    def own_attributes(self, request: Request) -> dict[str, Any]:
        """Return what else the group records of a request."""
        return {"options": request.options(self.name)}

    def _columns(self, rows: Mapping[int, Row]) -> tuple[str, ...]:
        """Columns of the study's table: variables with one value per profile, or several along the wide dimensions."""
        group = study_called(self.name)
        names = dict.fromkeys(name for row in rows.values() for name in row)
        own = [name for name in names if set(group[name].dims) <= {PROFILE, *self.wide_dims}]
        return tuple(dict.fromkeys((PROFILE, *self.mission_columns, *own)))


NO_ESTIMATE = "none"
"""Name stored as the estimate of a study that uses none."""


@dataclass(frozen=True, eq=False)
class RecordStudy(Study):
    """A study of the records alone. It uses no estimate, and profiles without one can be studied too.

    Its function of a profile gets no `ProfileData`, but the inputs that `prepare` returns.
    """

    def run(self, request: Request, settings: Any) -> None:
        """Study the chosen profiles, as `Study.run` does."""
        super().run(replace(request, estimate=NO_ESTIMATE), settings)

    def choose(self, archive: Archive, text: str | None, quick: bool) -> tuple[int, ...]:
        """Choose among all profiles of an archive, as `Study.choose` does among the finished ones."""
        return chosen_among(list(positions(archive)), text, quick)

    def reader(self, request: Request) -> ReadFunction:
        """Return a function that reads nothing."""
        return _read_nothing

    def own_attributes(self, request: Request) -> dict[str, Any]:
        """Return nothing: hull and settings are attributes already."""
        return {}


def _read_nothing(archive: Archive, number: int) -> None:
    """Read no estimate."""


@dataclass(frozen=True, eq=False)
class ProfileJob:
    """Job of a worker: reads one profile and studies it.

    Attributes
    ----------
    name : str
        Name of the study.
    profile : callable
        `Study.profile`.
    read : callable
        ``(archive, number) -> data``.
    settings : Settings or None
        Settings of the study.
    """

    name: str
    profile: ProfileFunction
    read: ReadFunction
    settings: Any

    def __call__(self, archive: Archive, job: tuple[int, int], inputs: Any) -> StudiedProfile:
        """Study a profile by number and position, and separate the rows that the worker writes from other values."""
        number, index = job
        data = self.read(archive, number)
        try:
            values = self.profile(data, ProfileContext(number, archive, self.settings, inputs))
        except ProfileError as error:
            values = {"message": str(error)}
        chunked = {variable.name for variable in study_called(self.name).variables if variable.is_row}
        table_row = {key: value for key, value in values.items() if key not in chunked}
        return StudiedProfile(number, index, table_row, {key: values[key] for key in values if key in chunked})


def _table_rows(name: str, rows: Mapping[int, Row], further: Mapping[int, Row]) -> dict[int, Row]:
    """Join the rows of each profile, and remove the values that only the mission's function uses."""
    names = {variable.name for variable in study_called(name).variables}
    joined = {number: {**rows.get(number, {}), **further.get(number, {})} for number in (*rows, *further)}
    return {number: {key: row[key] for key in row if key in names} for number, row in joined.items()}


def _begin(request: Request, name: str, content: GroupContent) -> tuple[str, ...]:
    """Create or replace a study's group; return a remark if the group held the study of another estimate."""
    before = study_attributes(request.archive, name).get("estimate", request.estimate)
    create_study(request.archive, name, content.sizes, attributes={"estimate": request.estimate}, labels=content.labels)
    if before == request.estimate:
        return ()
    return (f"the archive's group {name} held the study of the {before} estimate; this one replaces it",)
