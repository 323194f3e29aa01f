"""Inversion of one profile, or of a whole mission."""

import logging
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr
from threadpoolctl import threadpool_limits

from gliderhpc.api.arguments import Hull, Profiles, chosen_profile, platform_of, profiles_text, settings_of
from gliderhpc.api.workers import Scheduler, cluster_of, executor_of
from gliderhpc.archive import mission as archived
from gliderhpc.errors import InputError
from gliderhpc.estimation.engines import check_engine
from gliderhpc.estimation.preparation import check_seawater
from gliderhpc.mission import run
from gliderhpc.mission.cluster import FileNotSharedError
from gliderhpc.mission.executors import Executor
from gliderhpc.mission.jobs import ProfileResult
from gliderhpc.mission.local_workers import default_workers
from gliderhpc.mission.lock import lock_name
from gliderhpc.mission.planning import MissionPlan, plan_mission, select_profiles
from gliderhpc.mission.run import MissionResult
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.mission.warm import warm_kernels
from gliderhpc.observations import Observations
from gliderhpc.observations.in_memory import Records, opened_records
from gliderhpc.platform import Platform
from gliderhpc.store_schema.place import Place, is_address
from gliderhpc.tuning.record_checks import inspect_records
from gliderhpc.wording import most_frequent_reason, python_words, speaks_python

log = logging.getLogger("gliderhpc.run")

CHECKED_PROFILES, LAG_PROFILES = 24, 4
"""Maximum numbers of profiles examined before a run: for all record checks except the lag, and for the lag."""


@speaks_python
def invert(
    records: Records, hull: Hull, profile: int | None = None, *, settings: MissionSettings | None = None, **named: Any
) -> xr.DataTree:
    """Invert one profile: EKF prior, smoother, windowed adjoint inversion and depth-averaged current.

    Parameters
    ----------
    records : xarray.Dataset, str or Path
        Observations: a Dataset returned by `open_records` or made by hand in the same format, or the path of a file.
    hull : Platform, str or Path
        The glider's hull: a platform, the name of a shipped one, or a path.
    profile : int, optional
        Number of the profile; optional if there is only one.
    settings : MissionSettings, optional
        Settings of the run.
    **named
        Settings by name, which override those of `settings`: ``preset="paper"``, ``window={"length": 60.0}``.

    Returns
    -------
    xarray.DataTree
        The archive's groups for this profile (``series``, ``prior``, ``state``, ``observed``, ``smoothed``,
        ``windows``, ``drift_current``) and its row of the root table, in memory. Values, types, units and attributes
        are those that `run_mission` writes.

    Raises
    ------
    InputError
        An argument cannot be used.
    ProfileError
        The profile cannot be inverted.

    Examples
    --------
    >>> dive = invert("m12.nc", "petrel-l", profile=12)  # doctest: +SKIP
    >>> dive["series"].ds.B_cr.sel(profile=12)  # doctest: +SKIP
    """
    chosen = settings_of(MissionSettings, settings, named)
    check_engine(chosen)
    platform = platform_of(hull)
    with opened_records(records) as observations:
        number = chosen_profile(observations.profile_numbers, profile)
        return run.invert_profile(observations, platform, chosen, number)


@speaks_python
def run_mission(
    records: Records,
    hull: Hull,
    store: Place,
    *,
    profiles: Profiles = None,
    workers: int | None = None,
    scheduler: Scheduler = None,
    overwrite: bool = False,
    resume: bool = False,
    append: bool = False,
    settings: MissionSettings | None = None,
    **named: Any,
) -> xr.DataTree:
    """Invert every profile of a mission into an archive, as ``gliderhpc run-mission`` does.

    Parameters
    ----------
    records : xarray.Dataset, str or Path
        Observations. A Dataset that differs from its file is written to a temporary file for the run.
    hull : Platform, str or Path
        The glider's hull: a platform, the name of a shipped one, or a path.
    store : str or Path
        The archive: a folder, or an address such as ``s3://bucket/mission.zarr``.
    profiles : int, iterable of int, or str, optional
        Profiles to invert, such as ``[18, 19]`` or ``"18:20,68"``; all by default.
    workers : int, optional
        Number of worker processes, 0 to compute in this process; by default one per core, if memory allows.
    scheduler : str or Path, optional
        Address of a running Dask cluster's scheduler, or the file that it wrote.
    overwrite, resume, append : bool
        Replace an existing archive; finish one; or finish one and add profiles that are new in the observations.
    settings : MissionSettings, optional
        Settings of the run.
    **named
        Settings by name, which override those of `settings`: ``preset="paper"``, ``engine="scipy"``,
        ``start="smoothed"``.

    Returns
    -------
    xarray.DataTree
        The archive, opened lazily. A profile that failed has the status ``failed`` and a message.

    Raises
    ------
    InputError
        An argument cannot be used, the archive exists and none of `overwrite`, `resume` and `append` is set, or another
        run is writing it.
    RunStoppedError
        The run had to stop, for example because no worker was left. Finished profiles are valid; ``resume=True``
        computes the rest.

    Notes
    -----
    Worker processes import the main module. A script must therefore call this function under
    ``if __name__ == "__main__":``, or with ``workers=0``.
    """
    if sum((resume, append, overwrite)) > 1:
        raise InputError("overwrite, resume and append are mutually exclusive; give one of them")
    chosen = settings_of(MissionSettings, settings, named)
    check_engine(chosen)
    platform, cluster = platform_of(hull), cluster_of(scheduler)
    # Arguments are checked before anything is read.
    archived.check_is_path(store, "store")
    executor_of(workers, cluster)
    place = store if is_address(store) else Path(store)
    with opened_records(records) as observations:
        text, shared = profiles_text(profiles), cluster is not None
        prepared = prepare_mission(observations, platform, chosen, text, workers, on_cluster=shared, warn=log.warning)
        if not (resume or append):
            warn_about_records(observations, platform, chosen, prepared.plan.profiles, python_words)
        own, warm = None if shared else prepared.workers, partial(warm_kernels, chosen.engine)
        executor = executor_of(own, cluster, prepared.needed(place), len(prepared.plan.profiles), warm)
        try:
            prepared.run(place, executor, overwrite=overwrite, resume=resume, append=append)
        except FileNotSharedError as error:
            if not isinstance(records, xr.Dataset) or error.path != observations.path.resolve():
                raise
            raise InputError(
                f"records: a Dataset that was made or changed in memory, which {error.worker} cannot see; save it to a "
                "file that the workers share, records.to_netcdf('m12.nc'), and give its path"
            ) from None
    return open_mission(place)


open_mission = speaks_python(archived.open_mission)


@dataclass(frozen=True, eq=False)
class PreparedMission:
    """A run that is ready to begin: its inputs are checked, and its workers fit into memory.

    Attributes
    ----------
    observations, platform, settings : Observations, Platform, MissionSettings
        The open file, the hull and the settings.
    plan : MissionPlan
        Chosen profiles, and the sizes of their archive.
    workers : int
        Number of local worker processes.
    """

    observations: Observations
    platform: Platform
    settings: MissionSettings
    plan: MissionPlan
    workers: int

    def needed(self, place: Place) -> tuple[Path, ...]:
        """Return the files that workers on other machines must see: observations, and the lock of a local archive."""
        return (self.observations.path, *([Path(lock_name(place))] if isinstance(place, Path) else []))

    def run(
        self,
        place: Place,
        executor: Callable[[], AbstractContextManager[Executor]],
        *,
        overwrite: bool = False,
        resume: bool = False,
        append: bool = False,
        check_last: int | None = None,
        report: Callable[[ProfileResult], None] = lambda _: None,
    ) -> MissionResult:
        """Run the inversion, as `gliderhpc.mission.run.run_mission` does."""
        return run.run_mission(
            self.observations,
            self.platform,
            self.settings,
            self.plan.profiles,
            place,
            executor,
            overwrite=overwrite,
            resume=resume,
            append=append,
            check_last=check_last,
            report=report,
        )


def prepare_mission(
    observations: Observations,
    platform: Platform,
    settings: MissionSettings,
    profiles: str | None,
    workers: int | None,
    *,
    on_cluster: bool,
    warn: Callable[[str], None],
) -> PreparedMission:
    """Choose the profiles of a run and the number of its workers.

    Parameters
    ----------
    observations, platform, settings : Observations, Platform, MissionSettings
        The open file, the hull and the settings.
    profiles : str, optional
        Choice of profiles, such as ``18:20,68``; all by default.
    workers : int, optional
        Number of local worker processes; by default one per core, if memory allows.
    on_cluster : bool
        Whether the run is on a cluster, whose memory is not checked.
    warn : callable
        Function called with each warning about the file.

    Raises
    ------
    InputError
        There is no such profile or no usable one, or the workers need more memory than the machine has.
    """
    chosen = select_profiles(observations.profile_numbers, profiles)
    for warning in observations.warnings:
        warn(warning)
    if not set(chosen) - set(observations.faults):
        reason = most_frequent_reason(observations.faults[number] for number in chosen)
        raise InputError(f"{observations.path}: no usable profile; {reason}")
    check_seawater(platform, settings)
    plan = plan_mission(observations, settings, chosen)
    count = default_workers() if workers is None else workers
    if not on_cluster:
        if workers is None:
            count = plan.workers_that_fit(settings, count)
        plan.check_memory(settings, count)
    return PreparedMission(observations, platform, settings, plan, count)


def warn_about_records(
    observations: Observations,
    platform: Platform,
    settings: MissionSettings,
    chosen: Sequence[int],
    words: Callable[[str], str] = str,
) -> None:
    """Log one line, adapted by `words`, for each error that a brief check of the records finds; correct nothing."""
    checks = settings.inspect
    brief = checks.model_copy(
        update={
            "profiles": min(checks.profiles, CHECKED_PROFILES),
            "lag_profiles": min(checks.lag_profiles, LAG_PROFILES),
        }
    )
    with threadpool_limits(limits=1):
        found = inspect_records(observations, platform, chosen, settings, brief, settings.current)
    for finding in found.found:
        log.warning("%s", words(f"{finding.line} (for details run gliderhpc inspect)"))
