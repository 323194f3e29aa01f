"""Inversion of one profile, or of a whole mission."""

import logging
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr
from threadpoolctl import threadpool_limits

from gliderhpc.api.arguments import HullArgument, Profiles, chosen_profile, platform_of, profiles_text, settings_of
from gliderhpc.api.workers import Scheduler, cluster_of, executor_of
from gliderhpc.archive import mission as archived
from gliderhpc.errors import InputError
from gliderhpc.mission import run
from gliderhpc.mission.cluster import ClusterAddress, FileNotSharedError
from gliderhpc.mission.executors import Progress, no_progress
from gliderhpc.mission.planning import PreparedMission, prepare_mission
from gliderhpc.mission.run import Existing
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.mission.warm import warm_kernels
from gliderhpc.observations import Observations
from gliderhpc.observations.in_memory import Records, opened_records
from gliderhpc.platform import Platform
from gliderhpc.record_checks import inspect_records
from gliderhpc.store_schema.location import Location, is_address

log = logging.getLogger("gliderhpc.run")

CHECKED_PROFILES, LAG_PROFILES = 24, 4
"""Maximum numbers of profiles examined before a run: for all record checks except the lag, and for the lag."""


def invert(
    records: Records,
    hull: HullArgument,
    profile: int | None = None,
    *,
    settings: MissionSettings | None = None,
    **named: Any,
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
    platform = platform_of(hull)
    with opened_records(records) as observations:
        number = chosen_profile(observations.profile_numbers, profile)
        return run.invert_profile(observations, platform, chosen, number)


def run_mission(
    records: Records,
    hull: HullArgument,
    store: Location,
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
    existing = Existing.of(overwrite=overwrite, resume=resume, append=append)
    chosen = settings_of(MissionSettings, settings, named)
    platform, cluster = platform_of(hull), cluster_of(scheduler)
    # Arguments are checked before anything is read.
    archived.check_is_path(store, "store")
    executor_of(workers, cluster)
    archive = store if is_address(store) else Path(store)
    with opened_records(records) as observations:
        text, shared = profiles_text(profiles), cluster is not None
        prepared = prepare_mission(observations, platform, chosen, text, workers, on_cluster=shared, warn=_warn)
        try:
            invert_prepared(prepared, archive, cluster, existing=existing)
        except FileNotSharedError as error:
            if not isinstance(records, xr.Dataset) or error.path != observations.path.resolve():
                raise
            raise InputError(
                f"records: a Dataset that was made or changed in memory, which {error.worker} cannot see; save it to a "
                "file that the workers share, records.to_netcdf('m12.nc'), and give its path"
            ) from None
    return archived.open_mission(archive)


def invert_prepared(
    prepared: PreparedMission,
    store: Location,
    cluster: ClusterAddress | None = None,
    *,
    existing: Existing = Existing.REFUSE,
    progress: Progress = no_progress,
) -> run.MissionResult:
    """Run a prepared inversion on local workers or a cluster, after a brief check of the records of a new archive.

    Parameters
    ----------
    prepared : PreparedMission
        The run.
    store : str or Path
        The archive.
    cluster : ClusterAddress, optional
        Running cluster; by default as many local workers as the run was prepared for.
    existing : Existing
        Treatment of an archive that exists.
    progress : callable
        Opens the display of progress over a number of profiles; its context is the function that advances it.
    """
    numbers = prepared.plan.profiles
    if not existing.continues:
        warn_about_records(prepared.observations, prepared.platform, prepared.settings, numbers)
    workers, warm = None if cluster is not None else prepared.workers, partial(warm_kernels, prepared.settings.engine)
    executor = executor_of(workers, cluster, prepared.needed(store), len(numbers), warm)
    with progress(len(numbers)) as advance:
        return run.run_mission(prepared, store, executor, existing=existing, on_result=lambda _: advance())


def _warn(text: str) -> None:
    log.warning("%s", text)


def warn_about_records(
    observations: Observations,
    platform: Platform,
    settings: MissionSettings,
    chosen: Sequence[int],
) -> None:
    """Log one line for each error that a brief check of the records finds; correct nothing."""
    checks = settings.inspect
    brief = checks.model_copy(
        update={
            "profiles": min(checks.profiles, CHECKED_PROFILES),
            "lag_profiles": min(checks.lag_profiles, LAG_PROFILES),
        }
    )
    with threadpool_limits(limits=1):
        inspection = inspect_records(observations, platform, chosen, settings, brief, settings.current)
    for finding in inspection.found:
        log.warning("%s (for details run `gliderhpc inspect`)", finding.line)
