"""How a study was made, as its group's attributes keep it: what showing it takes besides the group's arrays."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.store_schema.grow import OUTDATED


@dataclass(frozen=True)
class Provenance:
    """How a study was made.

    Attributes
    ----------
    profiles : tuple of int
        That were studied, whether or not anything came of them.
    columns : tuple of str
        Of the study's table, in its order; those that the group does not have are the mission's.
    estimate : str
        Whose disturbances and motion.
    quick : bool
        Whether it was a first look.
    settings : mapping
        Of the study, as JSON holds them.
    remarks : tuple of str
        What its reader should know of its inputs, such as one that was not given.
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
    """Read how a study was made.

    Raises
    ------
    InputError
        The study was left by a version of this program that did not say.
    """
    values = {field.name: kept(archive, name, field.name) for field in fields(Provenance)}
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
    outdated = archive[name].attrs.get(OUTDATED)
    if outdated:
        values["remarks"] += (f"this study was {outdated}; run it again",)
    return Provenance(**values)


def kept(archive: xr.DataTree, name: str, key: str) -> Any:
    """What a study's group keeps under the name of an attribute.

    Raises
    ------
    InputError
        The study was left by a version of this program that did not keep it.
    """
    attributes = archive[name].attrs
    if key not in attributes:
        raise InputError(
            f"the archive's study {name} does not tell its {key}, as an earlier version of gliderhpc left it; run it "
            "again"
        )
    return attributes[key]
