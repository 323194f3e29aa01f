"""Peak memory of the workers of a run."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import psutil


@dataclass
class PeakMemory:
    """Largest resident memory seen, bytes: of one worker process, and of the process that started them."""

    worker: int = 0
    parent: int = 0

    @property
    def of_a_worker(self) -> int:
        """Peak of the process that did the work: the parent's where it started none."""
        return self.worker or self.parent

    def sample(self, process: psutil.Process) -> None:
        """Take the present figures in."""
        self.parent = max(self.parent, _resident(process))
        try:
            children = process.children(recursive=True)
        except psutil.NoSuchProcess:
            return
        self.worker = max([self.worker, *(_resident(child) for child in children)])


@contextmanager
def watched_memory(process_id: int | None = None, interval: float = 0.1) -> Iterator[PeakMemory]:
    """Sample a process (this one by default) and its descendants every `interval` seconds until the block ends."""
    process, peak, done = psutil.Process(process_id), PeakMemory(), threading.Event()

    def watch() -> None:
        while not done.wait(interval):
            peak.sample(process)

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield peak
    finally:
        done.set()
        thread.join()


def _resident(process: psutil.Process) -> int:
    try:
        return int(process.memory_info().rss)
    except psutil.Error:
        # It ended between being listed and being asked.
        return 0
