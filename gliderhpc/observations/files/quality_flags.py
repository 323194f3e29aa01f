"""Quality flags of another program's file: values flagged as bad or missing are not used."""

import re
from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations.files.columns import NamedColumns, find_name
from gliderhpc.observations.records import FloatArray, TimeArray

Mask = npt.NDArray[np.bool_]

REJECTED = (3.0, 4.0, 9.0)
"""Flags of (probably) bad and of missing values in Argo and OG1, for files that do not give the meanings."""

MISSING = 9.0
"""Flag of missing values; where all values have it although they are there, the flags were never set."""

_BAD_MEANINGS = re.compile(r"bad|fail|missing|invalid|wrong|erroneous|reject", re.IGNORECASE)
"""Meanings of flags whose values are not used; QARTOD's 3, `suspect`, is not among them."""

_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


@dataclass(frozen=True, eq=False)
class Rejected:
    """Values of a file that are not used because of their flags.

    Attributes
    ----------
    masks : dict of str to (n,) bool array
        Mask of these values by variable.
    remark : str
        Remark that counts them; empty if there are none.
    """

    masks: dict[str, Mask] = field(default_factory=dict)
    remark: str = ""

    def without(self, name: str, values: FloatArray) -> FloatArray:
        """Values ``(n,)`` of a variable, NaN where they are not used."""
        mask = self.masks.get(name)
        return values if mask is None else np.where(mask, np.nan, values)

    def without_times(self, name: str, times: TimeArray) -> TimeArray:
        """Times ``(n,)`` of a variable, NaT where they are not used."""
        return np.where(self.masks.get(name, False), np.datetime64("NaT", "ns"), times)


def find_rejected(columns: NamedColumns, names: Iterable[str], needed: Container[str] = ()) -> Rejected:
    """Find the values that a file flags as bad or missing.

    Flags are taken from the variables that `ancillary_variables` names, from ``NAME_QC`` and, for positions, from
    ``POSITION_QC``.

    Parameters
    ----------
    columns : NamedColumns
        The file.
    names : iterable of str
        Names of the variables to check.
    needed : container of str
        Names of those without which the file is of no use.

    Raises
    ------
    InputError
        Every value of a needed variable is flagged; the message names both.
    """
    masks: dict[str, Mask] = {}
    counts: list[str] = []
    # A variable without flags is not read: it may be one that is not used.
    pairs = [(each, flag) for each in dict.fromkeys(names) for flag in _flags_of(columns, each)]
    for name, flag in pairs:
        known = columns.present(name)
        if len(columns.flags(flag)) != len(known):
            continue
        mask = known & _is_rejected(columns, flag, known)
        if not mask.any():
            continue
        if name in needed and (mask == known).all():
            raise InputError(
                f"{columns.source}: every value of {name} is flagged bad or missing by {flag}; if the values are "
                "right, correct or remove the flags"
            )
        masks[name] = masks.get(name, np.zeros(len(known), dtype=bool)) | mask
        counts.append(f"{np.count_nonzero(mask)} of {name} ({flag})")
    remark = f"values flagged bad or missing are not used: {', '.join(counts)}" if counts else ""
    return Rejected(masks, remark)


def _flags_of(columns: NamedColumns, name: str) -> Iterator[str]:
    """Names of the variables with the flags of a variable, each once."""
    there = columns.flag_names
    position = re.sub("latitude|longitude", "position", name.casefold())
    wanted = [*columns.attribute("ancillary_variables", name).split(), f"{name}_QC", f"{position}_qc"]
    found = (find_name(there, (each,)) for each in wanted)
    for flag in dict.fromkeys(flag for flag in found if flag is not None):
        if _holds_flags(columns, flag):
            yield flag


def _holds_flags(columns: NamedColumns, name: str) -> bool:
    """Return whether an ancillary variable holds flags, by its name, standard name or meanings, and no bit masks."""
    if columns.attribute("flag_masks", name):
        return False
    standard = columns.attribute("standard_name", name)
    return name.casefold().endswith("_qc") or "flag" in standard or bool(columns.attribute("flag_meanings", name))


def _is_rejected(columns: NamedColumns, flag: str, known: Mask) -> Mask:
    """Mask ``(n,)`` of the values whose flag is that of bad or missing ones."""
    flags = columns.flags(flag)
    at_values = flags[known]
    if len(at_values) and (at_values == MISSING).all():
        return np.zeros(len(flags), dtype=bool)
    return np.isin(
        flags, _rejected_flags(columns.attribute("flag_values", flag), columns.attribute("flag_meanings", flag))
    )


def _rejected_flags(values: str, meanings: str) -> tuple[float, ...]:
    """Flags of bad and missing values by the meanings in the file, or by the convention of Argo without these."""
    numbers, words = [float(text) for text in _NUMBER.findall(values)], re.split(r"[\s,]+", meanings.strip())
    if not meanings.strip() or len(numbers) != len(words):
        return REJECTED
    return tuple(number for number, word in zip(numbers, words, strict=True) if _BAD_MEANINGS.search(word))


def numeric_flags(values: npt.NDArray[np.generic]) -> FloatArray:
    """Flags ``(n,)`` as numbers, NaN where absent; flags written as characters may be one text of n characters."""
    if values.dtype.kind in "fiub":
        return np.atleast_1d(values).astype(np.float64)
    texts = np.char.strip(values.astype("U"))
    if texts.ndim == 0:
        texts = np.array(list(str(values.astype("U"))), dtype="U1")
    found = np.full(len(texts), np.nan)
    digits = np.char.isdigit(texts)
    found[digits] = texts[digits].astype(np.float64)
    return found
