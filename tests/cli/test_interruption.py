"""Interruptions of a command: none is lost, and none leaves a lock held."""

import _thread
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from xarray.backends import locks

from gliderhpc.cli.interruption import interruptible


@pytest.fixture(autouse=True)
def ctrl_c_as_in_a_terminal():
    """A shell starts background jobs with Ctrl-C ignored, and so may the tests be started."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def interrupted_by(action):
    """Do something that interrupts, and wait for the interruption for a minute at most; return whether it came."""
    try:
        with interruptible():
            action()
            for _ in range(6000):
                time.sleep(0.01)
    except KeyboardInterrupt:
        return True
    return False


class Finalised:
    """Object that is interrupted while it is finalised."""

    def __del__(self):
        os.kill(os.getpid(), signal.SIGTERM)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_each_signal_interrupts(number):
    before = signal.getsignal(number)
    if number == signal.SIGHUP:
        signal.signal(number, signal.SIG_DFL)  # The tests themselves may run under `nohup`.
    try:
        during = signal.getsignal(number)
        assert interrupted_by(lambda: os.kill(os.getpid(), number))
        assert signal.getsignal(number) == during
    finally:
        signal.signal(number, before)


def test_the_end_of_the_terminal_stays_ignored_under_nohup():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interruptible():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_an_interruption_that_python_would_drop_is_raised_again():
    """One that arrives while an object is finalised has no caller to be raised to."""
    assert interrupted_by(Finalised)


def test_an_error_after_a_dropped_interruption_is_an_interruption():
    """An interrupted callback of numba's compiler left it without a result, which was reported as a bug."""

    def compile_without_result():
        Finalised()
        raise RuntimeError("no compiled object yet")

    assert interrupted_by(compile_without_result)
    with pytest.raises(RuntimeError, match="no compiled object"), interruptible():
        raise RuntimeError("no compiled object yet")


def test_an_interruption_while_a_lock_of_a_file_is_taken_leaves_it_free():
    """Ctrl-C after the lock was taken and before its block was entered made one import in a hundred wait for ever."""

    class Interrupted:
        """Lock that is interrupted in the moment in which it has been taken."""

        def __init__(self):
            self.lock = threading.Lock()

        def acquire(self, blocking=True):
            taken = self.lock.acquire(blocking)
            _thread.interrupt_main(signal.SIGTERM)
            return taken

        def release(self):
            self.lock.release()

    def hold(lock):
        with lock:
            time.sleep(60.0)

    inner = Interrupted()
    assert interrupted_by(lambda: hold(locks.CombinedLock([inner])))
    assert inner.lock.acquire(blocking=False)


def test_an_interruption_leaves_a_condition_unlocked():
    condition = threading.Condition(threading.Lock())

    def take_and_release():
        threading.Timer(0.01, _thread.interrupt_main, [signal.SIGTERM]).start()
        while True:
            with condition:
                pass

    assert interrupted_by(take_and_release)
    assert condition.acquire(blocking=False)


def test_the_exit_status_is_130_while_a_library_executes_source_text(tmp_path):
    """`python -m` ended by a signal instead: one command in ten, interrupted while it imported libraries."""
    text = "import os, signal, time; os.kill(os.getpid(), signal.SIGTERM); time.sleep(60.0)"
    lines = ("from gliderhpc.cli.main import main, program", f"program.main = lambda **_: exec({text!r})", "main([])")
    (tmp_path / "entry.py").write_text("\n".join(lines))
    command = [sys.executable, "-m", "entry"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "interrupted" in ended.stderr
    assert ended.returncode == 130


def test_ctrl_c_stays_ignored_where_it_was():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interruptible():
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.05)
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_another_thread_is_left_alone():
    before, ended = signal.getsignal(signal.SIGTERM), []

    def work():
        with interruptible():
            ended.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert ended == [before]
