"""The errors a user can cause, each with a message fit to be read on one line."""


class GliderhpcError(Exception):
    """Base of every error that gliderhpc raises on purpose; its text is one clear line."""


class InputError(GliderhpcError):
    """Something the user gave cannot be used: the message names it and the remedy (exit status 2)."""


class ProfileError(GliderhpcError):
    """One profile cannot be estimated; the rest of the mission goes on (its message is stored)."""


class RunStoppedError(GliderhpcError):
    """A run had to stop before its end; what it has done stands and can be finished (exit status 1)."""


class CalibrationError(GliderhpcError):
    """A calibration found no hull that is better than the one it started from; nothing is written (exit status 1)."""


def first_line(error: BaseException) -> str:
    """What another library's error says, on one line of bounded length; its class where it says nothing."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0][:200] if lines else type(error).__name__
