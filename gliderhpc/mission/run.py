"""Running a mission: every chosen profile into the archive, and what came of it."""

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from gliderhpc.estimation.diagnosis import SLOPE_BIAS
from gliderhpc.estimation.preparation import check_seawater
from gliderhpc.estimation.profile import check_engine
from gliderhpc.mission.batch_job import ProfileResult
from gliderhpc.mission.executors import Executor
from gliderhpc.mission.lock import locked
from gliderhpc.mission.planning import MissionPlan, plan_mission
from gliderhpc.mission.profile_rows import Row
from gliderhpc.mission.resume import examine_archive, make_ready
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.mission.standing import MISSING, Standing
from gliderhpc.mission.work import MissionWork, profile_results
from gliderhpc.observations import Observations
from gliderhpc.platform import Platform
from gliderhpc.store_schema import BUOYANCY, consolidate, write_mission_table
from gliderhpc.store_schema.commits import is_begun
from gliderhpc.store_schema.create import check_place, new_archive
from gliderhpc.store_schema.place import Place, absolute
from gliderhpc.store_schema.replacement import restore_set_aside
from gliderhpc.version import __version__

log = logging.getLogger(__name__)

TABLE_INTERVAL = 5.0
"""Seconds between updates of the archive's table while a run goes on."""

Opened = AbstractContextManager[Executor]


@dataclass
class MissionResult:
    """What a run did: the table's row of every profile, by number, and those that an earlier run had left done."""

    rows: dict[int, Row] = field(default_factory=dict)
    kept: tuple[int, ...] = ()
    seconds: float = 0.0

    @property
    def failed(self) -> tuple[int, ...]:
        """Numbers of the profiles that failed."""
        return tuple(number for number, row in sorted(self.rows.items()) if row["status"] == "failed")


def run_mission(
    observations: Observations,
    platform: Platform,
    settings: MissionSettings,
    profiles: tuple[int, ...],
    store: Place,
    executor: Callable[[], Opened],
    *,
    overwrite: bool = False,
    resume: bool = False,
    append: bool = False,
    report: Callable[[ProfileResult], None] = lambda _: None,
) -> MissionResult:
    """Estimate the chosen profiles of an open observation file into an archive.

    Parameters
    ----------
    observations : Observations
        The open file; its faulty profiles are recorded as failed with their fault.
    platform, settings : Platform, MissionSettings
        The hull and the settings; both are stored with the archive.
    profiles : tuple of int
        Numbers to do.
    store : str or Path
        The archive.
    executor : callable
        Opens where jobs run; called only when there is something to do.
    overwrite, resume, append : bool
        Replace an archive; finish one, doing anew what was made from other inputs or is damaged; the same, with the
        profiles that the observation file has gained.
    report : callable
        Called with each result as it comes.

    Raises
    ------
    InputError
        An archive exists and none of these was asked for, or another run is writing it, or it was made for other
        profiles or by another schema; or density is asked for with a hull that states no compressibility; or the
        engine cannot run here.
    RunStoppedError
        There was nobody left to run on; what is done stands.
    OSError
        The disk is full or lost; what is done stands.
    """
    check_engine(settings)
    check_seawater(platform, settings)
    _say_what_is_not_used(observations, platform, settings)
    began = time.monotonic()
    plan = plan_mission(observations, settings, profiles)
    attributes = archive_attributes(observations, platform, settings)
    work = MissionWork(observations, platform, settings, absolute(store))
    with locked(store) as token:
        restore_set_aside(store)
        ready: Callable[[str], AbstractContextManager[Callable[[], None]]]
        begun = is_begun(store)
        if begun and (resume or append):
            numbers, standing = examine_archive(work, plan, append)
            ready = partial(_resumed, work, attributes, plan, standing, append)
        else:
            check_place(store, overwrite or not begun)
            numbers, standing = list(plan.profiles), Standing({}, dict.fromkeys(range(len(plan.profiles)), MISSING))
            ready = partial(new_archive, store, np.array(plan.profiles), plan.sizes, attributes)
        result = MissionResult({numbers[index]: row for index, row in standing.kept.items()})
        result.kept = tuple(sorted(result.rows))
        waiting = [(numbers[index], index) for index in standing.anew]
        # The archive is touched only once there is somewhere to run, and settled only when nobody writes any more.
        with ExitStack() as settled, executor() if waiting else nullcontext() as opened:
            commit_stands = settled.enter_context(ready(token))
            if opened is not None:
                _execute(opened, work, token, waiting, dict(standing.kept), result, _both(commit_stands, report))
            consolidate(store)
    _warn_of_slope(platform, result)
    result.seconds = time.monotonic() - began
    return result


def _say_what_is_not_used(observations: Observations, platform: Platform, settings: MissionSettings) -> None:
    if settings.seawater == "auto" and observations.has_seawater and platform.buoyancy.compressibility is None:
        log.info(
            "buoyancy by the depth slope: temperature and salinity are there, but the platform %s states no "
            "buoyancy.compressibility; `gliderhpc calibrate` finds one", platform.name,
        )  # fmt: skip


def _warn_of_slope(platform: Platform, result: MissionResult) -> None:
    """Warn of the profiles whose buoyancy went by the depth slope though the hull goes by density."""
    if platform.buoyancy.compressibility is None:
        return
    slope = BUOYANCY.meanings["depth_slope"]
    numbers = [number for number, row in sorted(result.rows.items()) if row.get("buoyancy") == slope]
    if numbers:
        log.warning(
            "profile %s: buoyancy by the depth slope, not by density, with the platform %s: %s; leave them out, or "
            "calibrate a hull for them with seawater=depth_slope", ", ".join(map(str, numbers)), platform.name,
            SLOPE_BIAS,
        )  # fmt: skip


def archive_attributes(observations: Observations, platform: Platform, settings: MissionSettings) -> dict[str, Any]:
    """Root attributes: what was done to what, by what, so that it can be done again."""
    return {
        "title": "Forces, moments and currents from an underwater glider's routine records",
        "mission": observations.mission,
        "platform_id": observations.platform_id,
        "platform": platform.model_dump(mode="json"),
        "settings": settings.model_dump(mode="json"),
        "preset": settings.preset,
        "engine": settings.engine,
        "step": settings.step,
        "output_interval": settings.output_interval,
        "software_version": __version__,
        "observations": observations.path.name,
        "observations_digest": observations.digest(),
        "observations_source": observations.source,
    }


def _execute(
    opened: Executor,
    work: MissionWork,
    token: str,
    profiles: Sequence[tuple[int, int]],
    table: dict[int, Row],
    result: MissionResult,
    report: Callable[[ProfileResult], None],
) -> None:
    """Do the profiles; keep the archive's table current, and leave it true whatever ends the run."""
    written = time.monotonic()
    try:
        for done in profile_results(opened, work, token, profiles):
            result.rows[done.number] = table[done.index] = done.row
            _log(done)
            report(done)
            if time.monotonic() - written > TABLE_INTERVAL:
                write_mission_table(work.store, table)
                written = time.monotonic()
    finally:
        write_mission_table(work.store, table)


@contextmanager
def _resumed(
    work: MissionWork, attributes: dict[str, Any], plan: MissionPlan, standing: Standing, append: bool, token: str
) -> Iterator[Callable[[], None]]:
    """Make an archive ready that is there already; it stays whatever becomes of the run."""
    make_ready(work, attributes, plan, standing, append)
    yield lambda: None


def _both(
    commit_stands: Callable[[], None], report: Callable[[ProfileResult], None]
) -> Callable[[ProfileResult], None]:
    def reported(done: ProfileResult) -> None:
        commit_stands()
        report(done)

    return reported


def _log(done: ProfileResult) -> None:
    row = done.row
    detail = (
        f" in {row['run_seconds']:.1f} s: {row['window_count']} windows, {row['converged_fraction']:.0%} converged"
        if row["status"] == "done" else ""
    )  # fmt: skip
    log.info(
        "profile %d %s%s%s", done.number, row["status"], detail, f" ({row['message']})" if row["message"] else "",
    )  # fmt: skip
