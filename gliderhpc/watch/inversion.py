"""Inversion of the dives of a watch into its archive, with workers that stay open between dives."""

import logging
from collections.abc import Iterable, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, field
from functools import partial

from gliderhpc.api.workers import executor_of
from gliderhpc.errors import InputError
from gliderhpc.mission.executors import Executor
from gliderhpc.mission.planning import prepare_mission
from gliderhpc.mission.run import Existing, run_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.mission.warm import warm_kernels
from gliderhpc.observations import Observations
from gliderhpc.observations.profile_numbers import select_profiles
from gliderhpc.platform import Platform
from gliderhpc.store_schema import SCHEMA_VERSION, is_archive, read_profiles
from gliderhpc.store_schema.commits import is_begun
from gliderhpc.store_schema.location import Location
from gliderhpc.store_schema.rows import read_attributes
from gliderhpc.version import __version__

log = logging.getLogger("gliderhpc.watch")

_CHECKED = 20
"""Number of dives at the end of the archive that are checked for damage with each new dive."""


@dataclass
class WatchWorkers:
    """Executor of a watch, which stays open, since starting workers for every dive would take seconds each time.

    Attributes
    ----------
    number : int or None
        Number of worker processes; None to choose it by the number of dives.
    engine : str
        Engine of the windows, whose kernels are loaded before the first dive.
    """

    number: int | None
    engine: str
    _contexts: ExitStack = field(default_factory=ExitStack, init=False)
    _opened: tuple[int, Executor] | None = field(default=None, init=False)

    def number_for(self, dives: int) -> int | None:
        """Return the number of worker processes for a number of dives; None for one per core.

        In this process, a single dive uses a second thread, and no worker has to be started.
        """
        return 0 if self.number is None and dives == 1 else self.number

    def open(self, workers: int) -> Executor:
        """Return the executor with a number of worker processes."""
        if self._opened is None or self._opened[0] != workers:
            self.close()
            opening = executor_of(workers, warm=partial(warm_kernels, self.engine))
            self._opened = workers, self._contexts.enter_context(opening())
        return self._opened[1]

    def close(self) -> None:
        """End the worker processes."""
        self._opened = None
        self._contexts.close()


def invert_new(
    observations: Observations,
    new: int,
    platform: Platform,
    settings: MissionSettings,
    store: Location,
    workers: WatchWorkers,
) -> None:
    """Invert the new dives of a mission into its archive; rebuild it if they cannot be added.

    Parameters
    ----------
    observations : Observations
        All records that have arrived.
    new : int
        Number of dives that are new or whose record has changed.
    platform, settings : Platform, MissionSettings
        The hull and the settings of the inversion.
    store : str or Path
        The archive.
    workers : WatchWorkers
        Workers of the watch.
    """
    numbers = select_profiles(observations.profile_numbers, None)
    reason = reason_to_rebuild(store, numbers)
    if reason:
        log.warning("%s: %s; the archive is rebuilt", store, reason)
    waiting = len(numbers) if reason else max(1, count_waiting(store, numbers, new, platform, settings))
    prepared = prepare_mission(
        observations, platform, settings, None, workers.number_for(waiting), on_cluster=False, warn=log.warning
    )
    run_mission(
        prepared,
        store,
        lambda: nullcontext(workers.open(min(prepared.workers, waiting))),
        existing=Existing.OVERWRITE if reason else Existing.APPEND,
        check_last=_CHECKED,
    )


def reason_to_rebuild(store: Location, numbers: Iterable[int]) -> str:
    """Return why profiles cannot be added to an archive; empty if they can, or if there is no archive yet.

    Raises
    ------
    InputError
        The archive contains a profile that is not among them, so it is another mission's.
    """
    if not _has_archive(store):
        return ""
    before, after = list(read_profiles(store)), list(numbers)
    foreign = sorted(set(before) - set(after))
    if foreign:
        raise InputError(f"{store}: contains profile {foreign[0]}, which is not in the source; give another `store`")
    version = read_attributes(store).get("schema_version")
    if version != SCHEMA_VERSION:
        return f"it has schema version {version}, and this program's is {SCHEMA_VERSION}"
    return "" if after[: len(before)] == before else "a dive arrived after later ones"


def _has_archive(store: Location) -> bool:
    return is_begun(store) and is_archive(store)


def count_waiting(
    store: Location, numbers: Sequence[int], new: int, platform: Platform, settings: MissionSettings
) -> int:
    """Count the dives that will be inverted: the new ones, or all if hull, settings or program have changed."""
    if not _has_archive(store):
        return len(numbers)
    made_with = read_attributes(store)
    now = {
        "platform": platform.model_dump(mode="json"),
        "settings": settings.model_dump(mode="json"),
        "software_version": __version__,
    }
    return new if all(made_with.get(name) == value for name, value in now.items()) else len(numbers)
