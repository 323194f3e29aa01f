"""Program ``gliderhpc``: verbs and exit statuses."""

import importlib
import io
import os
import signal
import sys
import warnings

import click
from click.shell_completion import get_completion_class

from gliderhpc.cli.interruption import clear_unhandled_mark, interruptible
from gliderhpc.cli.messages import (
    Verb,
    describe_unexpected,
    is_memory_shortage,
    is_unusable,
    names_a_file,
    printable,
    refuse_empty,
)
from gliderhpc.errors import CalibrationError, GliderhpcError, InputError, RunStoppedError
from gliderhpc.garbage import infrequent_collection
from gliderhpc.output_files import NO_SPACE
from gliderhpc.version import __version__

DONE, FAILED, UNUSABLE, INTERRUPTED = 0, 1, 2, 130
"""Exit statuses: done; something failed during the run; wrong usage or input; interrupted."""

UNREAD = 128 + signal.SIGPIPE
"""Exit status if the output pipe closed early (for example by `head`), as of any program in a shell's pipe."""

MIN_ADDRESS_SPACE = 600_000_000
"""Smallest limit (bytes) in which numpy, scipy and numba can be loaded. With less, OpenBLAS does not fail but tries to
allocate its buffers forever, or interrupts the process as Ctrl-C does."""

VERBS = {
    "run-mission": "run_mission",
    "simulate-mission": "simulate_mission",
    "import": "records",
    "currents": "currents",
    "watch": "watch",
    "export": "report",
    "twin": "twin",
    "platforms": "platforms",
    "inspect": "records",
    "calibrate": "hulls",
    "tune": "hulls",
    "validate": "studies",
    "analyze": "studies",
    "report": "report",
    "check": "archive",
    "compare": "archive",
    "info": "archive",
    "demo": "demo",
    "doctor": "doctor",
    "completion": "main",
}
"""Module of each verb, imported when the verb is used."""

SUMMARIES = {
    "run-mission": "Estimate currents and disturbances of every profile.",
    "simulate-mission": "Simulate a mission and the records of its sensors.",
    "import": "Convert an instrument's files into an observation file.",
    "currents": "Estimate currents from attitude, depth and fixes alone.",
    "watch": "Invert and report every new dive as its files arrive.",
    "export": "Write a mission's results as OG1 or currents.",
    "twin": "Compare estimates with the truth of simulated missions.",
    "platforms": "List the hulls, or show one with its steady glides.",
    "inspect": "Check records for sensor and clock errors.",
    "calibrate": "Estimate a hull's parameters from its own dives.",
    "tune": "Estimate the prior of the disturbances from records.",
    "validate": "Compare the open-loop flight model with the records.",
    "analyze": "Run one or all studies on a finished mission.",
    "report": "Write one or several missions as HTML pages.",
    "check": "Check that an archive is complete and undamaged.",
    "compare": "List the differences between two archives.",
    "info": "Summarise an archive.",
    "demo": "Simulate, invert, study and report on a mission.",
    "doctor": "Check the requirements of a run on this machine.",
    "completion": "Print the completion script for a shell.",
}
"""Summary of each verb, defined here to list the verbs without importing their modules."""

INTERRUPTED_STATE = {
    "run-mission": "the archive is intact",
    "simulate-mission": "nothing was written",
    "currents": "nothing was written",
    "watch": "every dive reported is in the archive",
    "export": "nothing was written",
    "inspect": "nothing was written",
    "calibrate": "nothing was written",
    "tune": "nothing was written",
    "validate": "the archive is unchanged",
    "analyze": "studies that were complete are still in the archive",
    "twin": "nothing was written",
    "report": "the page may be that of an earlier report",
}
"""State after an interruption of each verb, for the message."""

FEWER = "use fewer --workers or fewer profiles at a time"
LESS_MEMORY = {
    "import": "give fewer files at a time, or a machine with more memory,",
    "currents": "give fewer files at a time, or a machine with more memory,",
    "simulate-mission": "simulate fewer profiles",
}
"""Remedies of verbs whose shortage of memory has another cause than workers."""

RESUMABLE = ("run-mission",)
"""Verbs that can be resumed; any other verb is run again."""


SHELLS = ("bash", "zsh", "fish")
"""Shells for which there is a completion script."""


class ClosedOutputError(Exception):
    """Output pipe closed early. Click would end the program with another status."""


class Verbs(click.Group):
    """Group of the verbs. A verb's module is imported only when the verb is used; listing the verbs imports none."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the verbs."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a verb's command."""
        if cmd_name not in VERBS:
            return None
        module = importlib.import_module(f"gliderhpc.cli.{VERBS[cmd_name]}")
        return next(
            value for value in vars(module).values() if isinstance(value, click.Command) and value.name == cmd_name
        )

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command of the first word; suggest a verb for one that is misspelt."""
        word = args[0]
        if word not in VERBS and not word.startswith("-") and not ctx.resilient_parsing:
            # Only a mistake needs this import.
            from gliderhpc.shipped import nearest

            ctx.fail(f"no such command '{word}'{nearest(word, VERBS)}; commands are {', '.join(VERBS)}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> object:
        """Run the verb.

        Raises
        ------
        ClosedOutputError
            The output pipe was closed early.
        """
        try:
            return super().invoke(ctx)
        except BrokenPipeError as error:
            raise ClosedOutputError from error

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of verbs."""
        with formatter.section("Commands"):
            formatter.write_dl(list(SUMMARIES.items()))


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


@click.command("completion", cls=Verb)
@click.argument("shell", type=click.Choice(SHELLS))
def completion(shell: str) -> int:
    """Print the completion script for SHELL.

    \b
    Examples:
      gliderhpc completion bash > ~/.local/share/bash-completion/completions/gliderhpc
      gliderhpc completion zsh > ~/.zfunc/_gliderhpc
      gliderhpc completion fish > ~/.config/fish/completions/gliderhpc.fish
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    click.echo(completion_script(shell))
    return DONE


def completion_script(shell: str) -> str:
    """Return the completion script of one of `SHELLS`."""
    completion_class = get_completion_class(shell)
    if completion_class is None:
        raise click.BadParameter(f"{shell}: this version of click has no completion for it")
    return completion_class(program, {}, "gliderhpc", "_GLIDERHPC_COMPLETE").source()


def main(arguments: list[str] | None = None) -> None:
    """Run the program, report any error in one line, and exit with the status."""
    _open_standard_streams()
    # Figures are drawn to files only. Matplotlib cannot be imported with an unknown backend.
    os.environ["MPLBACKEND"] = "agg"
    verb = next((word for word in (sys.argv[1:] if arguments is None else arguments) if word in VERBS), "")
    status = _run(arguments, verb)
    sys.exit(_flush_output(status))


def _run(arguments: list[str] | None, verb: str) -> int:
    """Run a verb, report its error if any, and return the exit status."""
    remedy = "finish it with --resume" if verb in RESUMABLE else "run it again"
    try:
        with interruptible(), infrequent_collection(), warnings.catch_warnings():
            # Incomplete files of a killed run do not belong to an archive and need no warning.
            warnings.filterwarnings("ignore", message=r"Object at .*\.partial is not recognized")
            refuse_empty(sys.argv[1:] if arguments is None else arguments)
            _check_address_space()
            status = program.main(args=arguments, prog_name="gliderhpc", standalone_mode=False)
            return status if isinstance(status, int) else DONE
    except click.ClickException as error:
        shown = io.StringIO()
        error.show(shown)
        click.echo(printable(shown.getvalue()), err=True, nl=False)
        return UNUSABLE
    except RunStoppedError as error:
        return _report_end(f"{error}; the results so far are saved; {remedy}", FAILED)
    except CalibrationError as error:
        return _report_end(f"{error}; nothing is written", FAILED)
    except GliderhpcError as error:
        return _report_end(str(error), UNUSABLE)
    except (KeyboardInterrupt, click.Abort):
        return _report_interruption(verb, remedy)
    except SystemExit as end:
        # Rich ends the program if the output pipe is closed.
        if not isinstance(end.__context__, BrokenPipeError):
            raise
        _discard("stdout")
        return UNREAD
    except (ClosedOutputError, BrokenPipeError):
        _discard("stdout")
        return UNREAD
    except Exception as error:  # noqa: BLE001 - the last handler
        return _report_error(error, verb, remedy)


def _check_address_space() -> None:
    """Refuse a limit on the address space below `MIN_ADDRESS_SPACE`, before a library is loaded."""
    if sys.platform == "win32":
        return
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < MIN_ADDRESS_SPACE:
        raise InputError(
            f"not enough memory: this process may use {limit / 1e6:.0f} MB of address space, and needs at least "
            f"{MIN_ADDRESS_SPACE / 1e6:.0f} MB; raise the limit (ulimit -v, or that of the batch system)"
        )


def _report_error(error: Exception, verb: str, remedy: str) -> int:
    """Report an error of the machine, of the file system or of the program itself."""
    if is_memory_shortage(error):
        return _report_end(f"not enough memory; {LESS_MEMORY.get(verb, FEWER)} and {remedy}", FAILED)
    if isinstance(error, OSError):
        _discard_unwritable_output()
        return _report_system_error(error, remedy)
    if _follows_interruption(error):
        return _report_interruption(verb, remedy)
    return _report_end(describe_unexpected(error), FAILED)


def _report_interruption(verb: str, remedy: str) -> int:
    clear_unhandled_mark()
    left = ", ".join([*filter(None, [INTERRUPTED_STATE.get(verb)]), remedy])
    return _report_end(f"interrupted; {left}", INTERRUPTED)


def _follows_interruption(error: BaseException | None) -> bool:
    """Return whether an error was raised while an interruption was handled.

    A signal may arrive while a lock is acquired again, and the lock's own error then replaces the interruption.
    """
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__cause__ or error.__context__
    return False


def _report_system_error(error: OSError, remedy: str) -> int:
    if error.errno in NO_SPACE:
        return _report_end(
            f"no space left to write {error.filename or 'the results'}; free some space and {remedy}", FAILED
        )
    if names_a_file(error):
        return _report_end(f"{error.filename}: {error.strerror}", UNUSABLE if is_unusable(error) else FAILED)
    return _report_end(describe_unexpected(error), FAILED)


def _report_end(line: str, status: int) -> int:
    """Report the end of a command in one line on stderr, if it is open, and return the status."""
    try:
        click.echo(f"gliderhpc: {printable(line, lines=False)}", err=True)
    except OSError:
        _discard("stderr")
    return status


def _flush_output(status: int) -> int:
    """Flush the output and return the status, which is a failure if the output cannot be written."""
    for name in ("stdout", "stderr"):
        try:
            getattr(sys, name).flush()
        except BrokenPipeError:
            _discard(name)
            status = status or UNREAD
        except OSError as error:
            _discard(name)
            status = _report_end(f"the output cannot be written ({error.strerror})", max(status, FAILED))
    return status


def _discard_unwritable_output() -> None:
    """Discard the remaining output if it cannot be written; the error has been reported."""
    try:
        sys.stdout.flush()
    except OSError:
        _discard("stdout")


def _discard(name: str) -> None:
    """Replace a broken stream with the null device, so that closing it raises no error."""
    setattr(sys, name, open(os.devnull, "r" if name == "stdin" else "w", encoding="utf-8"))  # noqa: PTH123, SIM115 - it stays open


def _open_standard_streams() -> None:
    """Open standard streams that the caller has closed, and let stdout escape letters that its encoding lacks.

    Otherwise the next file opened gets their descriptor, and libraries print into that file.
    """
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            _discard(name)
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors in ("strict", "surrogateescape"):
        # As stderr does: a name with an umlaut would end a command whose output is in ASCII. The second treatment is
        # that of the locale C, and fails for such letters too.
        sys.stdout.reconfigure(errors="backslashreplace")
