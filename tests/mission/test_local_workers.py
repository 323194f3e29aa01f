"""Local worker processes: jobs over pipes, killed workers, termination, and no access for other users."""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest

from gliderhpc.errors import RunStoppedError
from gliderhpc.mission import local_workers
from gliderhpc.mission.executors import ALLOCATION, LocalExecutor, one_line, was_killed


@pytest.fixture(scope="module")
def executor():
    """Start two processes for all tests."""
    made = LocalExecutor(2)
    yield made
    made.close()


def _doubled(number):
    if number < 0:
        raise FloatingPointError("below zero")
    return 2 * number


def test_every_job_comes_back_once(executor):
    attempts = list(executor.attempts(_doubled, [*range(9), -1]))
    assert {attempt.job: attempt.result for attempt in attempts if attempt.error is None} == {
        n: 2 * n for n in range(9)
    }
    (failed,) = [attempt for attempt in attempts if attempt.error is not None]
    assert failed.job == -1
    assert one_line(failed.error) == "FloatingPointError: below zero"
    assert "in _doubled" in failed.error.__notes__[0]


def test_a_function_that_is_defined_where_it_is_used(executor):
    offset = 5

    def raised(number):
        return number + offset

    assert sorted(executor.run(raised, [1, 2])) == [6, 7]


class _AwkwardError(Exception):
    def __init__(self, one, two):
        super().__init__(f"{one} and {two}")


def test_an_error_that_cannot_be_sent_comes_as_text(executor):
    def fail(_):
        raise _AwkwardError(1, 2)

    (attempt,) = executor.attempts(fail, [0])
    assert isinstance(attempt.error, RuntimeError)
    assert "1 and 2" in str(attempt.error)


def test_a_result_that_cannot_be_sent_is_the_jobs_error(executor):
    (attempt,) = executor.attempts(lambda _: (n for n in range(3)), [0])
    assert "pickle" in str(attempt.error)


def _part_after_part(folder):
    yield "first"
    while not (folder / "seen").exists():
        time.sleep(0.01)
    yield "second"


def test_parts_come_before_the_job_ends(executor, tmp_path):
    parts = executor.stream(_part_after_part, [tmp_path])
    assert next(parts).result == "first"
    (tmp_path / "seen").touch()
    assert [part.result for part in parts] == ["second"]


def _killed_once(folder):
    marker = folder / "was-here"
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def test_a_killed_worker_is_replaced_and_its_job_done(executor, tmp_path):
    assert list(executor.run(_killed_once, [tmp_path])) == ["done"]


def _deadly(number):
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_a_job_that_kills_its_workers_fails_alone(executor):
    attempts = {attempt.job: attempt for attempt in executor.attempts(_deadly, [1, 2, 3])}
    assert [attempts[number].result for number in (1, 3)] == [1, 3]
    assert was_killed(attempts[2].error)
    assert one_line(attempts[2].error) == "the worker was killed or ran out of memory 4 times"


def _described(_):
    import dask

    environment = {name: os.environ.get(name) for name in (*ALLOCATION, "OMP_NUM_THREADS")}
    return os.getpid(), environment, dask.config.get("scheduler")


def test_the_environment_of_workers(executor, monkeypatch):
    ((_, environment, scheduler),) = executor.run(_described, [0])
    assert environment == {**{name: str(value) for name, value in ALLOCATION.items()}, "OMP_NUM_THREADS": "1"}
    assert scheduler == "synchronous"
    assert not set(ALLOCATION) & set(os.environ)


def _long(folder):
    (folder / str(os.getpid())).touch()
    yield os.getpid()
    time.sleep(600)


def test_leaving_ends_the_jobs_at_once(executor, tmp_path):
    parts = executor.stream(_long, [tmp_path, tmp_path])
    process = next(parts).result
    began = time.monotonic()
    parts.close()
    assert time.monotonic() - began < 5.0
    assert not psutil.pid_exists(process)


def test_workers_that_cannot_start_are_given_up(monkeypatch):
    monkeypatch.setattr(local_workers, "_serve", os.getpid)  # it takes no argument; the process ends at once
    executor = LocalExecutor(1)
    try:
        with pytest.raises(RunStoppedError, match=r"exit immediately \((exit status 1|signal SIGKILL)\); try"):
            list(executor.attempts(_doubled, [1]))
    finally:
        executor.close()


def _listening(_):
    """Return the sockets on which this process, its parent and its siblings listen."""
    family = [psutil.Process(os.getppid()), *psutil.Process(os.getppid()).children(recursive=True)]
    return [
        (process.pid, connection.laddr)
        for process in family
        for connection in process.net_connections("all")
        if connection.status == psutil.CONN_LISTEN or (connection.raddr == "" and connection.laddr)
    ]


def test_runs_and_workers_open_no_ports_or_sockets():
    """The run and its workers have no port and no named socket, so no one else can send them code."""
    code = (
        "import test_local_workers as t\n"
        "from gliderhpc.mission.executors import local_executor\n"
        "if __name__ == '__main__':\n"
        "    with local_executor(2, lambda: None) as executor:\n"
        "        print([found for each in executor.run(t._listening, [1, 2]) for found in each])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )  # fmt: skip
    assert done.stdout.strip() == "[]"


def test_workers_end_with_their_parent(tmp_path):
    code = (
        "import pathlib, test_local_workers as t\n"
        "from gliderhpc.mission.executors import LocalExecutor\n"
        "if __name__ == '__main__':\n"
        f"    folder = pathlib.Path({str(tmp_path)!r})\n"
        "    list(LocalExecutor(2).stream(t._long, [folder, folder]))\n"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    )
    until = time.monotonic() + 120
    while len(list(tmp_path.iterdir())) < 2:
        assert time.monotonic() < until
        time.sleep(0.05)
    parent.kill()
    parent.wait()
    workers = [int(path.name) for path in tmp_path.iterdir()]
    while any(psutil.pid_exists(worker) for worker in workers):
        assert time.monotonic() < until
        time.sleep(0.05)
