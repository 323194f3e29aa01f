"""Messages in the words of Python: arguments in the place of the commands' options."""

import re
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from gliderhpc.errors import GliderhpcError

Given = ParamSpec("Given")
Returned = TypeVar("Returned")

_OPTIONS = (
    (r"--set (?:platform\.)?", ""),
    (r"`gliderhpc run-mission --store`", "gliderhpc.run_mission"),
    (r"`gliderhpc import(?: \w+)?`", "gliderhpc.import_records"),
    (r"--(overwrite|resume|append)\b", r"\1=True"),
    (r"--hold-out\b", "hold_out"),
    (r"--workers (\d+)", r"workers=\1"),
    (r"--platform\b", "hull"),
    (r"--out\b", "path"),
    (r"--(store|profiles|workers|scheduler|model|budget|reference|observations|truth|profile|twins|estimate)\b", r"\1"),
)
"""Options of the commands as messages name them, each with the argument that is meant."""


def speaks_python(function: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """Let a function's errors name its arguments, not the commands' options."""

    @wraps(function)
    def called(*arguments: Given.args, **named: Given.kwargs) -> Returned:
        try:
            return function(*arguments, **named)
        except GliderhpcError as error:
            error.args = (python_words(str(error)),)
            raise

    return called


def python_words(message: str) -> str:
    """Give a message with arguments in the place of options."""
    for option, argument in _OPTIONS:
        message = re.sub(option, argument, message)
    return message
