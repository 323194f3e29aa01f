"""A run that is ready to begin: its profiles are chosen, its inputs are checked, and its workers fit into memory."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from gliderhpc.errors import InputError
from gliderhpc.estimation.engines import check_engine
from gliderhpc.estimation.preparation import check_seawater
from gliderhpc.mission.local_workers import default_workers
from gliderhpc.mission.lock import lock_name
from gliderhpc.mission.planning import MissionPlan, plan_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations
from gliderhpc.observations.profile_numbers import select_profiles
from gliderhpc.platform import Platform
from gliderhpc.store_schema.location import Location, check_assertions
from gliderhpc.wording import most_frequent_reason

log = logging.getLogger(__name__)


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

    def needed(self, location: Location) -> tuple[Path, ...]:
        """Return the files that workers on other machines must see: observations, and the lock of a local archive."""
        return (self.observations.path, *([Path(lock_name(location))] if isinstance(location, Path) else []))


def prepare_mission(
    observations: Observations,
    platform: Platform,
    settings: MissionSettings,
    profiles: str | Sequence[int] | None = None,
    workers: int | None = None,
    *,
    on_cluster: bool = False,
    warn: Callable[[str], None] = log.warning,
) -> PreparedMission:
    """Check the inputs of a run, and choose its profiles and the number of its workers.

    Parameters
    ----------
    observations, platform, settings : Observations, Platform, MissionSettings
        The open file, the hull and the settings.
    profiles : str or sequence of int, optional
        Choice of profiles, such as ``18:20,68``, or their numbers; all by default.
    workers : int, optional
        Number of local worker processes; by default one per core, if memory allows.
    on_cluster : bool
        Whether the run is on a cluster, whose memory is not checked.
    warn : callable
        Function called with each warning about the file.

    Raises
    ------
    InputError
        There is no such profile or no usable one, or the workers need more memory than the machine has; or buoyancy by
        density is set for a hull without compressibility; or the engine cannot run on this machine; or zarr cannot read
        archives in this Python.
    """
    check_assertions()
    check_engine(settings)
    if profiles is None or isinstance(profiles, str):
        profiles = select_profiles(observations.profile_numbers, profiles)
    chosen = tuple(profiles)
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
