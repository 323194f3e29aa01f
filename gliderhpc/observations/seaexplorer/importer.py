"""Import of SeaExplorer files: controls converted, observation file and summary out."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations.clock_steps import ClockStep, without_doubtful
from gliderhpc.observations.fixes import MAXIMUM_DRIFT
from gliderhpc.observations.imported import (
    ImportSummary,
    check_place,
    describe_reasons,
    median_interval,
    write_import,
)
from gliderhpc.observations.rows import Rows
from gliderhpc.observations.seaexplorer.ctd import read_ctd
from gliderhpc.observations.seaexplorer.legs import Leg, find_fixes, find_legs
from gliderhpc.observations.seaexplorer.rows import MissionFiles, find_files, is_seaexplorer_file, read_rows

_NAVIGATION = {
    "NavState": (0.0, 1000.0),
    "Heading": (-1e-9, 360.0 + 1e-9),
    "Declination": (-180.0, 180.0),
    "Pitch": (-90.0, 90.0),
    "Roll": (-180.0 - 1e-9, 180.0 + 1e-9),
    "Depth": (-10.0, 2000.0),
    "Lat": (-9000.1, 9000.1),
    "Lon": (-18000.1, 18000.1),
    "BallastPos": (-2000.0, 2000.0),
    "LinPos": (-1000.0, 1000.0),
    "AngPos": (-180.0, 180.0),
}
"""Columns of a navigation file and the open range of their plausible values."""


def import_seaexplorer(
    sources: Sequence[Path],
    out: Path,
    *,
    linear_scale: float = 0.5e-3,
    linear_zero: float = 60.0,
    include_surfacing: bool = False,
    overwrite: bool = False,
) -> ImportSummary:
    """Turn a SeaExplorer mission's text files into an observation file.

    Parameters
    ----------
    sources : sequence of Path
        ``*.gli.sub.*`` files with ``*.pld1.raw.*`` (delayed mode) or ``*.pld1.sub.*`` (real time), plain or gzipped,
        or folders of them, of one mission.
    out : Path
        The netCDF file to write.
    linear_scale : float
        Metres of battery travel a unit of ``LinPos``. The manufacturer does not document the unit.
    linear_zero : float
        ``LinPos`` at which ``battery_position`` is zero.
    include_surfacing : bool
        Count the surfacing manoeuvre (``NavState`` 115) as part of a profile.
    overwrite : bool
        Replace a file that is there.

    Returns
    -------
    ImportSummary
        Profiles, fixes and what was dropped; a mission without CTD, or parts of it, is remarked on.

    Raises
    ------
    InputError
        The sources are not one mission's records, hold no usable row, or `out` may not be replaced or
        cannot be written.
    """
    sources = [Path(source) for source in sources]
    check_place(Path(out), sources, is_seaexplorer_file, overwrite=overwrite)
    files = find_files(sources)
    dropped: Counter[str] = Counter()
    unreadable: dict[int, str] = {}
    steps: list[ClockStep] = []
    rows = read_rows(files.navigation, "Timestamp", _NAVIGATION, dropped, unreadable, steps=steps)
    if len(rows) == 0:
        raise InputError(
            next(
                iter(unreadable.values()), f"{sources[0]}: not one usable navigation row ({describe_reasons(dropped)})"
            )
        )
    rejected = {f"cycle {cycle}": why for cycle, why in unreadable.items()}
    legs, without = find_legs(rows, include_surfacing=include_surfacing)
    variables = convert(rows, linear_scale, linear_zero)
    numbers, fixes, lost, remarks = without_doubtful(steps, _number(legs, len(rows)), rows.time, find_fixes(rows))
    legs = [leg for leg in legs if leg.number not in lost]
    rejected |= {f"cycle {cycle}": why for cycle, why in lost.items()}
    variables["profile"] = numbers
    interval = median_interval(rows.time, [(leg.start, leg.stop) for leg in legs])
    ctd = read_ctd(files, rows.time, rows["Depth"], interval, dropped)
    variables |= ctd.variables
    without_profile = {f"cycle {cycle}": why for cycle, why in without.items() if f"cycle {cycle}" not in rejected}
    rows_dropped = dict(sorted(dropped.items()))
    mission = f"{files.vehicle}-M{files.mission}"
    attributes = {
        "platform": "seaexplorer",
        "platform_id": files.vehicle,
        "mission": mission,
        "source": f"ALSEAMAR SeaExplorer gli and pld1 text files, cycles {_describe_cycles(files)}",
        **_describe_processing(linear_scale, linear_zero, include_surfacing),
        "ctd_comment": ctd.comment,
        "cycles_without_profile": describe_reasons(without_profile),
        "cycles_rejected": describe_reasons(rejected),
        "rows_dropped": describe_reasons(rows_dropped),
    }
    return write_import(
        Path(out), variables, fixes, attributes,
        overwrite=overwrite, vehicle=files.vehicle, mission=mission, pieces="cycles",
        spans={leg.number: (leg.start, leg.stop) for leg in legs}, parts={leg.number: leg.cycles for leg in legs},
        sample_interval=interval, without_profile=without_profile, rejected=rejected,
        remarks=(*remarks, *ctd.remarks), rows_dropped=rows_dropped,
    )  # fmt: skip


def _number(legs: list[Leg], count: int) -> npt.NDArray[np.int64]:
    numbers = np.zeros(count, dtype=np.int64)
    for leg in legs:
        numbers[leg.start : leg.stop] = leg.number
    return numbers


def _describe_processing(linear_scale: float, linear_zero: float, include_surfacing: bool) -> dict[str, str | float]:
    ending = "the end of the surfacing manoeuvre (NavState 115)" if include_surfacing else "the surfacing manoeuvre"
    return {
        "battery_position_scale": linear_scale,
        "battery_position_zero": linear_zero,
        "battery_position_comment": "battery_position = battery_position_scale [m] * (LinPos - battery_position_zero)",
        "battery_rotation_comment": "AngPos taken as degrees, positive with starboard down",
        "ballast_volume_comment": "BallastPos taken as cm3",
        "heading_comment": "magnetic heading plus the declination in the same row of the file",
        "profile_comment": f"from the first row below the surface to {ending}; numbered by the cycle it begins in",
        "fix_comment": "rows of NavState 116 with a new position; one logged before a pause has the time of its end; "
        f"those that no drift below {MAXIMUM_DRIFT:g} m/s leads to are left out",
    }


def _describe_cycles(files: MissionFiles) -> str:
    cycles = list(files.navigation)
    return f"{cycles[0]}-{cycles[-1]}"


def convert(rows: Rows, linear_scale: float, linear_zero: float) -> dict[str, npt.NDArray[np.generic]]:
    """Attitude, depth and controls in the units and signs of the observation format.

    A positive ``AngPos`` goes with starboard down (0.4 degree of roll a degree on SEA035, correlation 0.9): the sign of
    the model's gamma. ``LinPos`` grows forward.

    Parameters
    ----------
    rows : Rows
        Navigation rows.
    linear_scale : float
        Metres of battery travel a unit of ``LinPos``.
    linear_zero : float
        ``LinPos`` at which the battery sits at its nominal position.
    """
    return {
        "time": rows.time,
        "depth": rows["Depth"],
        "roll": rows["Roll"],
        "pitch": rows["Pitch"],
        "heading": np.mod(rows["Heading"] + rows["Declination"], 360.0),
        "battery_position": linear_scale * (rows["LinPos"] - linear_zero),
        "battery_rotation": rows["AngPos"],
        "ballast_volume": rows["BallastPos"],
    }
