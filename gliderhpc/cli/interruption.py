"""Interrupt a command on Ctrl-C or SIGTERM, only where the exception is not lost and leaves no lock held."""

import _thread
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_PAUSE = 0.02
"""Seconds until an interruption at an unsafe moment is raised again."""

_MAX_PAUSES = 250
"""Maximum number of pauses; after them (about 5 s) the interruption is raised regardless."""

_LOCKING = ("xarray.backends.locks", "xarray.backends.file_manager")
"""Modules that take locks of files in Python code. An exception between taking a lock and entering the block that
releases it leaves the lock held, and the process hangs when it closes the file."""

_IGNORABLE = [signal.SIGINT, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else [])]
"""Signals that stay ignored if they were when the process started: Ctrl-C, and the end of the terminal (`nohup`)."""

_SEARCHED_FRAMES = 4
"""Number of innermost frames searched for those modules: their context managers are called through `contextlib`."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt on Ctrl-C, on the end of the terminal, and on SIGTERM, which batch systems send.

    An interruption at an unsafe moment is raised shortly afterwards: while a library takes or releases a lock, or where
    Python has no caller to raise the exception to, as in the callback of a weak reference. An error in the meantime is
    a consequence of it: a compiler, for example, misses the result of its callback.
    Ctrl-C remains ignored if it was ignored when the process started, as in a shell's background jobs, and so does the
    end of the terminal, as under `nohup`. The context has no effect outside the main thread, the only one that receives
    signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    later, pauses = _RepeatedSignal(), 0

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal pauses
        if pauses < _MAX_PAUSES and _handles_lock(frame):
            pauses += 1
            later.begin()
        else:
            later.pending = False
            raise KeyboardInterrupt

    def raise_again(unraisable: "sys.UnraisableHookArgs") -> None:
        if unraisable.exc_type is KeyboardInterrupt:
            # Not from here: Python would drop an exception of this hook too.
            later.begin()
        else:
            usual_hook(unraisable)

    numbers = [signal.SIGTERM, *(number for number in _IGNORABLE if signal.getsignal(number) is not signal.SIG_IGN)]
    usual_hook = sys.unraisablehook
    usual_handlers = {number: signal.signal(number, interrupt) for number in numbers}
    sys.unraisablehook = raise_again
    try:
        yield
    except Exception as error:
        if later.pending:
            raise KeyboardInterrupt from error
        raise
    finally:
        sys.unraisablehook = usual_hook
        # A signal sent after the usual handlers are restored would end the process.
        later.end()
        for number, handler in usual_handlers.items():
            signal.signal(number, handler)


def clear_unhandled_mark() -> None:
    """Clear Python's mark of an unhandled interruption, once the interruption has been handled.

    An interruption that passes through the execution of source text, as libraries do when they are imported, leaves
    this mark even if it is caught afterwards. Run with ``python -m``, Python would then end the process by a signal,
    whatever its exit status. Evaluating any source text clears the mark.
    """
    eval("None")


class _RepeatedSignal:
    """Thread that signals the main thread until an interruption has been raised there.

    It is begun in signal handlers, so it takes no lock of the module `threading`, which the main thread may hold.
    """

    def __init__(self) -> None:
        self.pending = False
        self._running = False

    def begin(self) -> None:
        """Signal after a moment, and again until `pending` is False."""
        self.pending = True
        if not self._running:
            self._running = True
            _thread.start_new_thread(self._run, ())

    def end(self) -> None:
        """Stop signalling, and wait for the thread."""
        self.pending = False
        while self._running:
            time.sleep(_PAUSE / 4.0)

    def _run(self) -> None:
        while True:
            time.sleep(_PAUSE)
            if self.pending:
                _signal_main_thread()
                continue
            self._running = False
            # An interruption that came just now saw a running thread.
            if not self.pending:
                return
            self._running = True


def _signal_main_thread() -> None:
    """Send SIGTERM to the main thread, since Ctrl-C may be ignored; a real signal also ends its waiting."""
    main = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and main is not None:
        signal.pthread_kill(main, signal.SIGTERM)
    else:
        _thread.interrupt_main(signal.SIGTERM)


def _handles_lock(frame: FrameType | None) -> bool:
    """Return whether one of the innermost frames takes or releases a lock in Python code."""
    for _ in range(_SEARCHED_FRAMES):
        if frame is None:
            return False
        module = frame.f_globals.get("__name__")
        if module in _LOCKING or (module == "threading" and frame.f_code.co_name in ("__enter__", "__exit__")):
            return True
        frame = frame.f_back
    return False
