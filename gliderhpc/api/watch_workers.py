"""Workers of a watch: this process for a single new dive, one process per core for several."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial

from gliderhpc.api.workers import executor_of
from gliderhpc.mission.executors import Executor
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.mission.warm import warm_kernels
from gliderhpc.platform import Platform
from gliderhpc.store_schema import is_archive
from gliderhpc.store_schema.commits import is_begun
from gliderhpc.store_schema.place import Place
from gliderhpc.store_schema.rows import read_attributes
from gliderhpc.version import __version__


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


def count_waiting(store: Place, numbers: Sequence[int], new: int, platform: Platform, settings: MissionSettings) -> int:
    """Count the dives that will be inverted: the new ones, or all if hull, settings or program have changed."""
    if not is_begun(store) or not is_archive(store):
        return len(numbers)
    made_with = read_attributes(store)
    now = {
        "platform": platform.model_dump(mode="json"),
        "settings": settings.model_dump(mode="json"),
        "software_version": __version__,
    }
    return new if all(made_with.get(name) == value for name, value in now.items()) else len(numbers)
