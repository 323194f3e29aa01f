"""Errors that a user can cause, each with a one-line message."""


class GliderhpcError(Exception):
    """Base class of all errors that gliderhpc raises deliberately; its message is one line.

    Messages and remarks name arguments and settings as Python does, in backquotes: `` `out` ``, `` `overwrite=True` ``,
    `` `window.length=60` ``. The commands show their options instead (`gliderhpc.cli.messages.with_options`).
    """


class InputError(GliderhpcError):
    """An input cannot be used; the message names it and the remedy (exit status 2)."""


class ArchiveInUseError(InputError):
    """Another process holds the lock of an archive; the same command can succeed later."""


class ProfileError(GliderhpcError):
    """One profile cannot be estimated; the message is stored, and the rest of the mission continues."""


class RunStoppedError(GliderhpcError):
    """A run had to stop before its end; its results so far are saved, and it can be resumed (exit status 1)."""


class CalibrationError(GliderhpcError):
    """A calibration found no better hull than the one it started from (exit status 1)."""


def message_line(error: BaseException) -> str:
    """Return the first line of an error's message that is not blank; empty where it has no message."""
    return next((line.strip() for line in str(error).splitlines() if line.strip()), "")


def first_line(error: BaseException) -> str:
    """Return the first line of an error's message, of bounded length, or its class where it has no message."""
    return message_line(error)[:200] or type(error).__name__
