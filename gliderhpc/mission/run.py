"""Running a mission: every chosen profile into the archive, and what came of it."""

import logging
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.estimation.preparation import check_seawater
from gliderhpc.mission.batch_job import BatchJob, ProfileResult, run_batch
from gliderhpc.mission.executors import Executor
from gliderhpc.mission.planning import MissionPlan, batch_size, plan_mission
from gliderhpc.mission.profile_rows import Row
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations
from gliderhpc.platform import Platform
from gliderhpc.store_schema import (
    SCHEMA_VERSION,
    consolidate,
    create_archive,
    is_archive,
    read_attributes,
    read_markers,
    read_profiles,
    write_table_rows,
)
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
    store: str | Path,
    executor: Callable[[], Opened],
    *,
    overwrite: bool = False,
    resume: bool = False,
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
    store : path
        The archive.
    executor : callable
        Opens where jobs run; called only when there is something to do.
    overwrite, resume : bool
        Replace an archive, or finish one made from the same input.
    report : callable
        Called with each result as it comes.

    Raises
    ------
    InputError
        An archive exists and neither was asked for, or the one to resume was made from other inputs; or density is
        asked for with a hull that states no compressibility.
    """
    check_seawater(platform, settings)
    _say_what_is_not_used(observations, platform, settings)
    began = time.monotonic()
    plan = plan_mission(observations, settings, profiles)
    attributes = archive_attributes(observations, platform, settings)
    result = MissionResult()
    if resume and Path(store).exists():
        _check_same(store, attributes, plan)
        done = {index: row for index, row in read_markers(store).items() if row["status"] == "done"}
        result.rows = {plan.profiles[index]: row for index, row in done.items()}
        result.kept = tuple(sorted(result.rows))
        write_table_rows(store, done)
    else:
        create_archive(store, np.array(plan.profiles), plan.sizes, attributes, overwrite=overwrite)
    waiting = [(number, index) for index, number in enumerate(plan.profiles) if number not in result.kept]
    if waiting:
        jobs = partial(_jobs, observations, platform, settings, store, waiting)
        _execute(jobs, store, executor, result, report)
    consolidate(store)
    result.seconds = time.monotonic() - began
    return result


def _say_what_is_not_used(observations: Observations, platform: Platform, settings: MissionSettings) -> None:
    if settings.seawater == "auto" and observations.has_seawater and platform.buoyancy.compressibility is None:
        log.info(
            "buoyancy by the depth slope: temperature and salinity are there, but the platform %s states no "
            "buoyancy.compressibility; `gliderhpc calibrate` finds one", platform.name,
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


def _check_same(store: str | Path, attributes: dict[str, Any], plan: MissionPlan) -> None:
    """Refuse to mix: what was done with other inputs must not stand beside what is done now."""
    if not is_archive(store):
        raise InputError(f"{store}: is no archive of gliderhpc, so there is nothing to resume; give another --store")
    stored = read_attributes(store)
    wanted = {**attributes, "schema_version": SCHEMA_VERSION}
    for key in ("observations_digest", "platform", "settings", "software_version", "schema_version"):
        if stored.get(key) != wanted[key]:
            raise InputError(
                f"{store}: was made with another {key.replace('_', ' ')}; resume with the same inputs, or start anew "
                "with --overwrite"
            )
    if tuple(read_profiles(store)) != plan.profiles:
        raise InputError(f"{store}: was made for other profiles; resume with the same --profiles, or use --overwrite")


def _jobs(
    observations: Observations,
    platform: Platform,
    settings: MissionSettings,
    store: str | Path,
    profiles: Sequence[tuple[int, int]],
    workers: int,
) -> list[BatchJob]:
    """Share profiles (numbers, positions) out: enough a job for the engine's lanes, and some for every worker."""
    start = min(observations.start_time(number) for number in observations.profile_numbers)
    size = batch_size(settings, len(profiles), workers)
    shares = [tuple(profiles[first : first + size]) for first in range(0, len(profiles), size)]
    return [
        BatchJob(
            share, str(Path(observations.path).resolve()), str(Path(store).resolve()),
            observations.survey.only(number for number, _ in share), platform, settings, start,
        )
        for share in shares
    ]  # fmt: skip


def _execute(
    jobs: Callable[[int], list[BatchJob]],
    store: str | Path,
    executor: Callable[[], Opened],
    result: MissionResult,
    report: Callable[[ProfileResult], None],
) -> None:
    """Run the jobs for so many workers; keep the archive's table current, and leave it true whatever ends the run."""
    pending: dict[int, Row] = {}
    written = time.monotonic()
    try:
        with executor() as opened:
            for done in chain.from_iterable(opened.run(run_batch, jobs(opened.workers))):
                result.rows[done.number] = pending[done.index] = done.row
                _log(done)
                report(done)
                if time.monotonic() - written > TABLE_INTERVAL:
                    write_table_rows(store, pending)
                    pending.clear()
                    written = time.monotonic()
    finally:
        write_table_rows(store, pending)


def _log(done: ProfileResult) -> None:
    row = done.row
    detail = (
        f"{row['window_count']} windows, {row['converged_fraction']:.0%} converged" if row["status"] == "done" else ""
    )
    log.info(
        "profile %d %s in %.1f s%s%s",
        done.number, row["status"], row["run_seconds"], f": {detail}" if detail else "",
        f" ({row['message']})" if row["message"] else "",
    )  # fmt: skip
