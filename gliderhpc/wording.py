"""Wording of messages: numbers of things, and arguments in place of the commands' options for callers from Python."""

import re
from collections import Counter
from collections.abc import Callable, Iterable
from functools import wraps
from typing import ParamSpec, TypeVar

from gliderhpc.errors import GliderhpcError

Given = ParamSpec("Given")
Returned = TypeVar("Returned")

_BEFORE, _AFTER = r"(?<![\w./-])", r"(?![\w-])(?!\.\w)"
"""Patterns of the characters that make an option next to them part of a file's name."""

_SAME = (
    "store|profiles|workers|scheduler|budget|reference|observations|truth|profile|twins|estimate|out|cache|declination"
)

_OPTIONS = (
    (r"--set (?:platform\.)?", ""),
    (r"`gliderhpc run-mission --store`", "gliderhpc.run_mission"),
    (r"`gliderhpc import(?: \w+)?`", "gliderhpc.import_records"),
    (r"`?gliderhpc inspect\b`?", "gliderhpc.inspect"),
    (rf"{_BEFORE}--(overwrite|resume|append){_AFTER}", r"\1=True"),
    (rf"{_BEFORE}--hold-out{_AFTER}", "hold_out"),
    (rf"{_BEFORE}--workers (\d+)", r"workers=\1"),
    (rf"{_BEFORE}--platform{_AFTER}", "hull"),
    (rf"{_BEFORE}--model{_AFTER}", "models"),
    (rf"{_BEFORE}--({_SAME}){_AFTER}", r"\1"),
)
"""Patterns of the commands' options in messages, each with its argument in Python."""


def counted(count: int, one: str, several: str = "") -> str:
    """Return a number of things, such as ``1 profile`` or ``3 profiles``.

    Parameters
    ----------
    count : int
        The number.
    one, several : str
        Name of the things in the singular and in the plural; by default the plural has an ``s`` at its end.
    """
    return f"{count} {one if count == 1 else several or f'{one}s'}"


_NUMBER = re.compile(r"[-+]?\d[\d.]*(e[-+]?\d+)?")


def most_frequent_reason(reasons: Iterable[str]) -> str:
    """Return the most frequent of several reasons as it was given first, with its count if there are several.

    Parameters
    ----------
    reasons : iterable of str
        At least one reason, such as those why profiles cannot be used; those that differ in numbers alone are the same.

    Returns
    -------
    str
        Such as ``11 of 12: profile 37: pitch is +18 degree while the glider sinks``.
    """
    given = list(reasons)
    kinds = [_NUMBER.sub("", reason) for reason in given]
    ((kind, count),) = Counter(kinds).most_common(1)
    first = given[kinds.index(kind)]
    return first if len(given) == 1 else f"{count} of {len(given)}: {first}"


def speaks_python(function: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """Make a function's errors name its arguments instead of the commands' options."""

    @wraps(function)
    def called(*arguments: Given.args, **named: Given.kwargs) -> Returned:
        try:
            return function(*arguments, **named)
        except GliderhpcError as error:
            error.args = (python_words(str(error)),)
            raise

    return called


def python_words(message: str) -> str:
    """Return a message with arguments in place of options."""
    for option, argument in _OPTIONS:
        message = re.sub(option, argument, message)
    return message
