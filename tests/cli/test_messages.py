"""Options of the commands in place of the arguments that the library's messages name."""

import ast
import re
from pathlib import Path

import click
import pytest

import gliderhpc
from gliderhpc.cli.main import VERBS, program
from gliderhpc.cli.messages import with_options

PACKAGE = Path(gliderhpc.__file__).parent

COMMAND_LINES = (
    "calibration/dives/text.py",
    "calibration/glides/text.py",
    "calibration/prior/text.py",
    "cli",
    "kernels/fortran/build.py",
    "report/page/fleet.py",
    "report/page/mission_page.py",
    "report/page/overview.py",
    "report/page/reproduction.py",
    "report/page/study_sections.py",
    "store_schema/commits.py",
    "studies/request.py",
    "twins/estimators/page.py",
)
"""Modules that write whole command lines, and so have options in their texts."""


def command_of(words):
    """Return the command of some words, such as ``twin windows``."""
    command = program
    for word in words.split():
        command = command.get_command(click.Context(command), word)
    return command


def commands(command=program):
    """Yield all commands."""
    if not isinstance(command, click.Group):
        yield command
        return
    for name in VERBS if command is program else command.commands:
        yield from commands(command.get_command(click.Context(command), name))


def texts(path):
    """Yield the texts of a module that are not docstrings."""
    tree = ast.parse(path.read_text("utf-8"))
    documentation = {node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in documentation:
            yield node.value


@pytest.mark.parametrize(
    ("words", "message", "shown"),
    [
        ("run-mission", "give `workers=3`", "give --workers 3"),
        ("run-mission", "use `resume=True` or another `store`", "use --resume or another --store"),
        ("run-mission", "`window.length`: no such setting", "--set window.length: no such setting"),
        ("run-mission", "give `seawater=auto`", "give --set seawater=auto"),
        ("run-mission", "`platform.mass.total=1`: too light", "--set platform.mass.total=1: too light"),
        ("analyze", "`profiles=1, 9`: no profile 9", "--profiles 1, 9: no profile 9"),
        ("analyze", "needs `models`", "needs --model"),
        ("analyze", "finish it with `resume=True`", "finish it with `resume=True`"),
        ("calibrate", "`hold_out` leaves no profile", "--hold-out leaves no profile"),
        ("import seaglider", "give another `out` or `overwrite=True`", "give another OUT.nc or --overwrite"),
        ("info", "give `seawater=auto`", "give `seawater=auto`"),
        ("inspect", "`gliderhpc check --deep`, `key: value`, `B_cr`", "`gliderhpc check --deep`, `key: value`, `B_cr`"),
    ],
)
def test_a_command_shows_its_options(words, message, shown):
    assert with_options(message, command_of(words)) == shown


def test_without_a_command_a_message_remains():
    assert with_options("give another `store`") == "give another `store`"


@pytest.mark.parametrize(
    "message", ["data/run--out.nc: no such file", "/d/m--profiles/a.nc: absent", "out/store: absent"]
)
def test_names_of_files_stay_as_they_are(message):
    assert with_options(message, command_of("run-mission")) == message


def test_messages_of_the_library_name_no_options():
    for path in sorted(PACKAGE.rglob("*.py")):
        module = path.relative_to(PACKAGE).as_posix()
        if module.startswith(COMMAND_LINES):
            continue
        for text in texts(path):
            outside_commands = re.sub(r"`?(gliderhpc|dask|pip) [^`]*`?", "", text)
            assert not re.search(r"(?<![\w-])--[a-z]", outside_commands), f"{module}: {text}"


def test_every_flag_in_a_message_is_an_option_of_a_command():
    known = {parameter.name for command in commands() for parameter in command.params}
    for path in sorted(PACKAGE.rglob("*.py")):
        for text in texts(path):
            assert set(re.findall(r"`(\w+)=True`", text)) <= known, f"{path}: {text}"
