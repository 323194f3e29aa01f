"""The observations of a synthetic mission on disk, appended profile by profile."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.appended import AppendedFile, Column
from gliderhpc.observations.format import CONVENTIONS, SEAWATER, VARIABLES
from gliderhpc.observations.records import Fix, ProfileRecord
from gliderhpc.observations.writer import variable_attributes

_DECIMALS = 9
"""Of degrees and cm3 in the file: undoes the rounding of the way to radians and back, so that quanta stay quanta."""

_TIMES = {
    "time": ("time", {"standard_name": "time", "long_name": "time", "axis": "T"}),
    "fix_time": ("fix", {"standard_name": "time", "long_name": "time of the GPS fix"}),
}


def observation_file(
    path: Path, attributes: Mapping[str, str | int | float], *, overwrite: bool = False
) -> AppendedFile:
    """Open an observation file for appending; one that is there is replaced at the end if `overwrite` says so."""
    return AppendedFile(path, {"Conventions": CONVENTIONS, **attributes}, {"fix": 1024}, overwrite=overwrite)


def observation_columns(record: ProfileRecord) -> dict[str, Column]:
    """Lay out one profile and its fixes for an observation file."""
    columns = {}
    for name, values in observation_variables([record]).items():
        dimension, attributes = _TIMES.get(name) or _of_format(name)
        columns[name] = Column((dimension,), values, attributes)
    return columns


def observation_variables(records: Sequence[ProfileRecord]) -> dict[str, npt.NDArray[np.generic]]:
    """Variables of the observation format, in its units, from records in the order of the mission.

    Fixes are taken from `ProfileRecord.surface_fixes_before` and `surface_fixes_after`.
    """
    columns = [_columns(record) for record in records]
    variables = {name: np.concatenate([column[name] for column in columns]) for name in columns[0]}
    fixes = [fix for record in records for fix in (*record.surface_fixes_before, *record.surface_fixes_after)]
    return variables | _fix_columns(fixes)


def _of_format(name: str) -> tuple[str, dict[str, str]]:
    variable = VARIABLES[name]
    return variable.dimension, variable_attributes(variable)


def _columns(record: ProfileRecord) -> dict[str, npt.NDArray[np.generic]]:
    seawater = {name: values for name in SEAWATER if (values := getattr(record, name)) is not None}
    return {
        "time": record.epoch + np.rint(record.time * 1e9).astype("timedelta64[ns]"),
        "profile": np.full(len(record.time), record.number, dtype=np.int32),
        "roll": np.round(np.degrees(record.roll), _DECIMALS),
        "pitch": np.round(np.degrees(record.pitch), _DECIMALS),
        "heading": np.mod(np.round(np.degrees(record.heading), _DECIMALS), 360.0),
        "depth": record.depth,
        "battery_position": record.battery_position,
        "battery_rotation": np.round(np.degrees(record.battery_rotation), _DECIMALS),
        "ballast_volume": np.round(record.ballast_volume * 1e6, _DECIMALS),
        **seawater,
    }


def _fix_columns(fixes: Sequence[Fix]) -> dict[str, npt.NDArray[np.generic]]:
    return {
        "fix_time": np.array([fix.time for fix in fixes], dtype="datetime64[ns]"),
        "fix_latitude": np.array([fix.latitude for fix in fixes]),
        "fix_longitude": np.array([fix.longitude for fix in fixes]),
    }
