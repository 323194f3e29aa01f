"""Wording of messages: numbers of things, beginnings of sentences, and the most frequent of several reasons."""

import re
from collections import Counter
from collections.abc import Iterable


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


def wanted_dataset(value: object) -> str:
    """Return the words for a Dataset that is wanted instead of a value, and how to make it from a table."""
    if hasattr(value, "to_xarray") and hasattr(value, "columns"):
        return "an xarray.Dataset (`to_xarray()` of the table with `time` as its index, with units and fixes)"
    return "an xarray.Dataset"


def capitalised(text: str) -> str:
    """Return a text with a capital first letter; the others, as in names, are unchanged."""
    return text[:1].upper() + text[1:]


_NUMBER = re.compile(r"[-+]?\d[\d.]*(e[-+]?\d+)?")


def most_frequent_reason(reasons: Iterable[str]) -> str:
    """Return the most frequent of several reasons, as first listed, with its count if there is more than one reason.

    Parameters
    ----------
    reasons : iterable of str
        At least one reason, such as those why profiles cannot be used. Those that differ only in numbers are the same.

    Returns
    -------
    str
        Such as ``11 of 12: profile 37: pitch is +18 degree while the glider sinks``.
    """
    texts = list(reasons)
    kinds = [_NUMBER.sub("", reason) for reason in texts]
    ((kind, count),) = Counter(kinds).most_common(1)
    first = texts[kinds.index(kind)]
    return first if len(texts) == 1 else f"{count} of {len(texts)}: {first}"
