"""Numbers of profiles: selected by a string, written as ranges, described, and evenly spread."""

import re
from collections.abc import Iterable, Sequence

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.wording import counted


def select_profiles(available: Sequence[int], text: str | None, argument: str = "profiles") -> tuple[int, ...]:
    """Select profiles by a string such as ``18:20,68`` (ranges are inclusive; ``18-20`` is accepted too), or all.

    Raises
    ------
    InputError
        The text is malformed, or names a profile that is not in the file.
    """
    if text is None:
        return tuple(sorted(available))
    chosen: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,18})\s*(?:[:-]\s*(\d{1,18})\s*)?", part)
        if match is None:
            raise InputError(f"`{argument}={text}`: '{part}' is neither a number nor a range such as 18:20")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise InputError(f"`{argument}={text}`: the range {part.strip()} runs backwards: write {last}:{first}")
        found = {number for number in available if first <= number <= last}
        if not found:
            raise InputError(
                f"`{argument}={text}`: no profile {part.strip()}; the available ones are {describe_numbers(available)}"
            )
        chosen |= found
    return tuple(sorted(chosen))


def as_ranges(numbers: Sequence[int]) -> str:
    """Write profile numbers as `select_profiles` reads them: ``18:20,68``."""
    ends = [*[i for i in range(1, len(numbers)) if numbers[i] != numbers[i - 1] + 1], len(numbers)]
    runs = [numbers[first:last] for first, last in zip([0, *ends], ends, strict=False)]
    return ",".join(f"{run[0]}:{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


def evenly_spaced(numbers: Sequence[int], count: int) -> list[int]:
    """Choose at most ``count`` of the numbers, evenly spread: the first and, from two on, the last among them."""
    places = np.unique(np.linspace(0, len(numbers) - 1, min(count, len(numbers))).round().astype(int))
    return [numbers[place] for place in places]


def describe_numbers(numbers: Iterable[int]) -> str:
    """Describe which profiles there are, for a message that refuses another."""
    ordered = sorted(numbers)
    return f"{ordered[0]} to {ordered[-1]} ({counted(len(ordered), 'profile')})" if ordered else "none"
