"""The program ``gliderhpc``: its verbs, and what its exit statuses mean."""

import errno
import importlib
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import click

from gliderhpc.errors import CalibrationError, GliderhpcError, RunStoppedError
from gliderhpc.version import __version__

DONE, FAILED, UNUSABLE, INTERRUPTED = 0, 1, 2, 130
"""Exit statuses: done; it ran and something failed; wrong usage or input; interrupted."""

VERBS = {
    "run-mission": "run_mission",
    "simulate-mission": "simulate_mission",
    "import": "import_",
    "export": "export",
    "twin": "twin",
    "platforms": "platforms",
    "inspect": "inspect",
    "calibrate": "calibrate",
    "tune": "tune",
    "validate": "validate",
    "analyze": "analyze",
    "report": "report",
    "check": "check",
    "compare": "compare",
    "info": "info",
    "demo": "demo",
    "doctor": "doctor",
    "completion": "completion",
}
"""Verb and the module of this package that holds it; imported only when it is asked for."""

LEFT = {
    "run-mission": "the archive is whole",
    "simulate-mission": "nothing was written",
    "export": "nothing was written",
    "inspect": "nothing was written",
    "calibrate": "nothing was written",
    "tune": "nothing was written",
    "validate": "of the archive only the group validation may be unfinished",
    "analyze": "of the archive only the study's group may be unfinished",
    "twin": "its runs are not kept",
    "report": "the page may be that of an earlier report",
}
"""What an interrupted verb leaves, where that is worth saying."""

RESUMED = ("run-mission",)
"""Verbs that go on where they were; any other is run again."""


class Verbs(click.Group):
    """The verbs in the order above, each imported on use so that ``--help`` stays quick."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the verbs."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a verb's command."""
        if cmd_name not in VERBS:
            return None
        module = importlib.import_module(f"gliderhpc.cli.{VERBS[cmd_name]}")
        command: click.Command = module.command
        return command


@click.group(cls=Verbs, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(__version__, prog_name="gliderhpc")
def program() -> None:
    """Currents, disturbances and hull health from an underwater glider's routine records.

    \b
    Example:
      gliderhpc simulate-mission mission.nc --platform petrel-l --profiles 4 --seed 1
      gliderhpc run-mission mission.nc --platform petrel-l --store mission.zarr
      gliderhpc info mission.zarr
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped


def main(arguments: list[str] | None = None) -> None:
    """Run the program and exit with its status; what a user can cause is told in one line."""
    verb = next((word for word in (sys.argv[1:] if arguments is None else arguments) if word in VERBS), "")
    remedy = "finish it with --resume" if verb in RESUMED else "run it again"
    try:
        with _terminated_as_interrupted():
            status = program.main(args=arguments, prog_name="gliderhpc", standalone_mode=False)
    except click.ClickException as error:
        error.show()
        sys.exit(UNUSABLE)
    except RunStoppedError as error:
        _say(f"{error}; what is done stands, {remedy}")
        sys.exit(FAILED)
    except CalibrationError as error:
        _say(str(error))
        sys.exit(FAILED)
    except GliderhpcError as error:
        _say(str(error))
        sys.exit(UNUSABLE)
    except (KeyboardInterrupt, click.Abort):
        _say(f"interrupted; {', '.join([*filter(None, [LEFT.get(verb)]), remedy])}")
        sys.exit(INTERRUPTED)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        _say(f"no space left to write {error.filename or 'the results'}; free some and {remedy}")
        sys.exit(FAILED)
    sys.exit(status if isinstance(status, int) else DONE)


@contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """Take SIGTERM, which batch systems send before they kill, for Ctrl-C."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _say(line: str) -> None:
    click.echo(f"gliderhpc: {line}", err=True)
