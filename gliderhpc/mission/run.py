"""Run of a mission: estimation of all chosen profiles into an archive, or of one in memory."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import partial
from typing import Any, Self

import numpy as np
import xarray as xr

from gliderhpc.archive.mission import open_mission
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.engines import check_engine
from gliderhpc.estimation.preparation import check_seawater
from gliderhpc.estimation.quality import SLOPE_BIAS, USUALLY_CONVERGED
from gliderhpc.estimation.settings import smoother_passes
from gliderhpc.mission.executors import Executor, OpenExecutor
from gliderhpc.mission.jobs import ProfileResult, RunInputs, profile_results, run_batch
from gliderhpc.mission.local_workers import default_workers
from gliderhpc.mission.lock import locked
from gliderhpc.mission.planning import MissionPlan, PreparedMission, plan_mission
from gliderhpc.mission.profile_rows import Row
from gliderhpc.mission.resume import MISSING, Validity, examine_archive, prepare_archive
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations
from gliderhpc.platform import Platform
from gliderhpc.store_schema import BUOYANCY, consolidate, create_archive, write_mission_table
from gliderhpc.store_schema.commits import is_begun
from gliderhpc.store_schema.create import check_location, new_archive
from gliderhpc.store_schema.location import Location, absolute, location_in_memory, remove_partial_files
from gliderhpc.store_schema.replacement import restore_set_aside
from gliderhpc.store_schema.schema import COMMITS, DISTURBANCE_PRIOR
from gliderhpc.version import __version__
from gliderhpc.wording import counted

log = logging.getLogger(__name__)

TABLE_INTERVAL = 5.0
"""Seconds between updates of the archive's table during a run."""

_SETTINGS_OF_SEVERAL_PASSES = ("tolerance", "adaptive", "estimate")
"""Settings of the smoother that have an effect only if it makes several passes."""

_MIN_PROFILES_TO_TUNE = 3
"""Minimum number of profiles for advice on the disturbance prior."""


class Existing(Enum):
    """Treatment of an existing archive; without one, a new archive is always created."""

    REFUSE = "refuse"
    """Refuse to run."""
    OVERWRITE = "overwrite"
    """Replace the archive."""
    RESUME = "resume"
    """Finish the archive, and recompute damaged profiles and those of other inputs."""
    APPEND = "append"
    """Finish the archive, and add profiles that are new in the observations."""

    @classmethod
    def of(cls, *, overwrite: bool, resume: bool, append: bool) -> Self:
        """Return the treatment that the user's options choose.

        Raises
        ------
        InputError
            More than one is set.
        """
        chosen = [name for name, given in (("overwrite", overwrite), ("resume", resume), ("append", append)) if given]
        if len(chosen) > 1:
            raise InputError(
                "`overwrite=True`, `resume=True` and `append=True` are mutually exclusive; give one of them"
            )
        return cls(chosen[0] if chosen else "refuse")

    @property
    def continues(self) -> bool:
        """Return whether results of the archive are retained."""
        return self in (Existing.RESUME, Existing.APPEND)


@dataclass
class MissionResult:
    """Result of a run.

    Attributes
    ----------
    rows : dict of int to Row
        Table row of every profile, by number.
    reused : tuple of int
        Numbers of the profiles that an earlier run had completed.
    seconds : float
        Duration of the run, s.
    """

    rows: dict[int, Row] = field(default_factory=dict)
    reused: tuple[int, ...] = ()
    seconds: float = 0.0

    @property
    def failed(self) -> tuple[int, ...]:
        """Numbers of the profiles that failed."""
        return tuple(number for number, row in sorted(self.rows.items()) if row["status"] == "failed")


def run_mission(
    prepared: PreparedMission,
    store: Location,
    executor: OpenExecutor,
    *,
    existing: Existing = Existing.REFUSE,
    check_last: int | None = None,
    on_result: Callable[[ProfileResult], None] = lambda _: None,
) -> MissionResult:
    """Estimate the chosen profiles of an open observation file into an archive.

    Parameters
    ----------
    prepared : PreparedMission
        The open file, whose faulty profiles are recorded as failed with their fault; the hull and the settings, which
        are stored with the archive; and the chosen profiles.
    store : str or Path
        The archive.
    executor : callable
        Function that opens the executor of the jobs; called only if a profile has to be computed.
    existing : Existing
        Treatment of an archive that exists.
    check_last : int, optional
        Number of profiles at the end of the archive that are checked for damage; by default all.
    on_result : callable
        Function called with each result as it arrives.

    Raises
    ------
    InputError
        An archive exists and `existing` does not allow it; or another run is writing it, or it was made for other
        profiles or by another schema.
    RunStoppedError
        No worker is left; the results so far are saved.
    OSError
        The disk is full or lost; the results so far are saved.
    """
    observations, platform, settings = prepared.observations, prepared.platform, prepared.settings
    _log_use_of_optional_variables(observations, platform, settings)
    _warn_about_unused_settings(platform, settings)
    began = time.monotonic()
    run = RunInputs(observations, platform, settings, absolute(store))
    with locked(store) as token:
        restore_set_aside(store)
        run, task = _examine(run, prepared.plan, existing, check_last)
        result = MissionResult({task.numbers[index]: row for index, row in task.validity.valid.items()})
        result.reused = tuple(sorted(result.rows))
        # The archive is changed only once an executor is available, and closed only after the last writer has ended.
        with ExitStack() as contexts, executor() if task.outstanding else nullcontext() as opened:
            on_commit = contexts.enter_context(task.open_archive(token))

            def on_profile(profile: ProfileResult) -> None:
                on_commit()
                on_result(profile)

            if opened is not None:
                _execute(opened, run, token, task, result, on_profile)
                # A killed worker may have left a partly written file; its profiles were completed by another worker.
                remove_partial_files(store)
            consolidate(store)
    _warn_about_depth_slope(platform, result)
    _advise_to_tune(platform, result)
    result.seconds = time.monotonic() - began
    return result


@dataclass(frozen=True)
class _Task:
    """Profiles of the archive, their validity, and the function that opens the archive with the lock's token."""

    numbers: list[int]
    validity: Validity
    open_archive: Callable[[str], AbstractContextManager[Callable[[], None]]]

    @property
    def outstanding(self) -> list[tuple[int, int]]:
        """Number and position of each profile that must be computed."""
        return [(self.numbers[index], index) for index in self.validity.outstanding]


def _examine(run: RunInputs, plan: MissionPlan, existing: Existing, check_last: int | None) -> tuple[RunInputs, _Task]:
    """Determine what must be computed, and add to the run's inputs the commits that can be amended."""
    attributes = archive_attributes(run.observations, run.platform, run.settings)
    begun = is_begun(run.store)
    if begun and existing.continues:
        append = existing is Existing.APPEND
        numbers, validity = examine_archive(run, plan, append, check_last)
        run = replace(run, amendable=validity.amendable)
        return run, _Task(numbers, validity, partial(_resume, run, attributes, plan, validity, append))
    check_location(run.store, existing is Existing.OVERWRITE or not begun)
    profiles = list(plan.profiles)
    validity = Validity({}, dict.fromkeys(range(len(profiles)), MISSING))
    return run, _Task(profiles, validity, partial(new_archive, run.store, np.array(profiles), plan.sizes, attributes))


def _log_use_of_optional_variables(observations: Observations, platform: Platform, settings: MissionSettings) -> None:
    if settings.seawater == "auto" and observations.has_seawater and platform.buoyancy.compressibility is None:
        log.info(
            "buoyancy from the depth slope: temperature and salinity are measured, but the platform %s states no "
            "buoyancy.compressibility; `gliderhpc calibrate` estimates one",
            platform.name,
        )
    if observations.has_velocity:
        log.info("the smoother uses the measured velocity relative to the water where it agrees with the depth rate")


def _warn_about_unused_settings(platform: Platform, settings: MissionSettings) -> None:
    """Warn of settings of the smoother that were set but have no effect, because it does not iterate."""
    unused = [name for name in _SETTINGS_OF_SEVERAL_PASSES if name in settings.smoother.model_fields_set]
    if unused and smoother_passes(platform, settings.smoother, platform.sensors.sample_interval) == 1:
        log.warning(
            "%s: no effect, because the smoother does not iterate over slow records of a hull without a disturbance "
            "prior of its own; `gliderhpc tune` estimates one, or set smoother.max_passes",
            ", ".join(f"smoother.{name}" for name in unused),
        )


def _warn_about_depth_slope(platform: Platform, result: MissionResult) -> None:
    """Warn of profiles whose buoyancy uses the depth slope although the hull is calibrated for density."""
    if platform.buoyancy.compressibility is None:
        return
    slope = BUOYANCY.meanings["depth_slope"]
    numbers = [number for number, row in sorted(result.rows.items()) if row.get("buoyancy") == slope]
    if numbers:
        log.warning(
            "profile %s: buoyancy from the depth slope, not from density, with the platform %s: %s; leave them out, or "
            "calibrate a hull for them with seawater=depth_slope",
            ", ".join(map(str, numbers)),
            platform.name,
            SLOPE_BIAS,
        )


def _advise_to_tune(platform: Platform, result: MissionResult) -> None:
    """Recommend a tuned prior if the usual one does not fit most profiles, and few windows converge."""
    done = [row for row in result.rows.values() if row["status"] == "done"]
    rough_water = DISTURBANCE_PRIOR.meanings["rough_water"]
    rough_count = sum(row.get("disturbance_prior") == rough_water for row in done)
    if platform.prior is not None or len(done) < _MIN_PROFILES_TO_TUNE or rough_count <= 0.5 * len(done):
        return
    if np.mean([row["converged_fraction"] for row in done]) < USUALLY_CONVERGED:
        log.info(
            "in %d of %d profiles the usual disturbance prior does not fit; `gliderhpc tune` estimates one from these "
            "records, with which more windows may converge",
            rough_count,
            len(done),
        )


def archive_attributes(observations: Observations, platform: Platform, settings: MissionSettings) -> dict[str, Any]:
    """Return the root attributes: inputs, settings and versions, with which the run can be reproduced."""
    return {
        "title": "Forces, moments and currents from an underwater glider's routine records",
        "mission": observations.mission,
        "platform_id": observations.platform_id,
        "platform": platform.model_dump(mode="json"),
        "settings": settings.model_dump(mode="json"),
        "preset": settings.preset,
        "engine": settings.engine,
        "start": settings.starts_from,
        "step": settings.step,
        "output_interval": settings.output_interval,
        "software_version": __version__,
        "observations": observations.path.name,
        "observations_digest": observations.digest(),
        "observations_source": observations.source,
    }


def _execute(
    executor: Executor,
    run: RunInputs,
    token: str,
    task: _Task,
    result: MissionResult,
    on_result: Callable[[ProfileResult], None],
) -> None:
    """Estimate the outstanding profiles; update the archive's table during the run, and at its end even on an error."""
    table = dict(task.validity.valid)
    last_update = time.monotonic()
    try:
        for profile in profile_results(executor, run, token, task.outstanding):
            result.rows[profile.number] = table[profile.index] = profile.row
            _log_result(profile)
            on_result(profile)
            if time.monotonic() - last_update > TABLE_INTERVAL:
                write_mission_table(run.store, table)
                last_update = time.monotonic()
    finally:
        write_mission_table(run.store, table)


@contextmanager
def _resume(
    run: RunInputs, attributes: dict[str, Any], plan: MissionPlan, validity: Validity, append: bool, token: str
) -> Iterator[Callable[[], None]]:
    """Prepare an existing archive, which remains even if the run fails."""
    prepare_archive(run, attributes, plan, validity, append)
    yield lambda: None


def _log_result(result: ProfileResult) -> None:
    row = result.row
    if result.amended:
        log.info("profile %d: only its fixes have changed, so only its currents were recomputed", result.number)
        return
    detail = (
        f" in {row['run_seconds']:.1f} s: {counted(row['window_count'], 'window')}, "
        f"{row['converged_fraction']:.0%} converged"
        if row["status"] == "done"
        else ""
    )
    log.info(
        "profile %d %s%s%s",
        result.number,
        row["status"],
        detail,
        f" ({row['message']})" if row["message"] else "",
    )


def invert_profile(
    observations: Observations, platform: Platform, settings: MissionSettings, number: int
) -> xr.DataTree:
    """Estimate one profile, and return the archive that `run_mission` would write for it, in memory.

    Parameters
    ----------
    observations : Observations
        The open file.
    platform, settings : Platform, MissionSettings
        The hull and the settings.
    number : int
        Number of the profile.

    Returns
    -------
    xarray.DataTree
        Archive of a run on this profile alone, without the group of the commit markers; its rows are as long as the
        profile.

    Raises
    ------
    ProfileError
        The profile cannot be estimated.
    InputError
        Same reasons as in `prepare_mission`.
    """
    import dask

    check_engine(settings)
    check_seawater(platform, settings)
    plan = plan_mission(observations, settings, (number,))
    with location_in_memory() as location:
        create_archive(location, np.array([number]), plan.sizes, archive_attributes(observations, platform, settings))
        run = RunInputs(observations, platform, settings, str(location))
        job = replace(run.job(((number, 0),), token=None), threads=default_workers())
        (result,) = run_batch(observations, job)
        if result.row["status"] != "done":
            raise ProfileError(result.row["message"])
        write_mission_table(location, {0: result.row})
        # Without dask's threads, which would not run in a forked process.
        with open_mission(location) as archive, dask.config.set(scheduler="synchronous"):
            tree = archive.load()
    return tree.drop_nodes(COMMITS)
