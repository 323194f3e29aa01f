"""Provenance of a study, in its group's attributes: with the group's arrays, all that showing the study takes."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.store_schema.maintenance import OUTDATED


@dataclass(frozen=True)
class Provenance:
    """Profiles, columns, estimate, settings and remarks of a study.

    Attributes
    ----------
    profiles : tuple of int
        Studied, with or without a result.
    columns : tuple of str
        Of the study's table, in order; those that the group lacks are the mission's.
    estimate : str
        Whose disturbances and motion.
    quick : bool
        True for a first look.
    settings : mapping
        Of the study, as JSON holds them.
    remarks : tuple of str
        On the inputs, such as one that was not given.
    """

    profiles: tuple[int, ...]
    columns: tuple[str, ...]
    estimate: str
    quick: bool
    settings: Mapping[str, Any]
    remarks: tuple[str, ...]

    def attributes(self) -> dict[str, Any]:
        """As attributes of the group."""
        return asdict(self)


def provenance_of(archive: xr.DataTree, name: str) -> Provenance:
    """Read the provenance of a study.

    Raises
    ------
    InputError
        The study was written by a version of this program that did not record it.
    """
    values = {field.name: stored_attribute(archive, name, field.name) for field in fields(Provenance)}
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
    outdated = archive[name].attrs.get(OUTDATED)
    if outdated:
        values["remarks"] += (f"this study was {outdated}; run it again",)
    return Provenance(**values)


def stored_attribute(archive: xr.DataTree, name: str, key: str) -> Any:
    """Return an attribute of a study's group.

    Raises
    ------
    InputError
        The study was written by a version of this program that did not record it.
    """
    attributes = archive[name].attrs
    if key not in attributes:
        raise InputError(
            f"the archive's study {name} does not record its {key}, as an earlier version of gliderhpc wrote it; run "
            "it again"
        )
    return attributes[key]
