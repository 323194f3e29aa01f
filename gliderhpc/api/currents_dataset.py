"""Dataset of the currents estimated without a flight model: a row for each profile, and series along time."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.estimation.currents import current_row, fix_row, surface_drift_row
from gliderhpc.estimation.glide_currents import GlideErrors, GlideTrack, positions
from gliderhpc.flight.glide_polar import GlidePolar
from gliderhpc.observations.files.discovery import CONVENTIONS, discovery_attributes, with_content_types
from gliderhpc.observations.navigation.records import Navigation
from gliderhpc.observations.records import Fix, ProfileRecord
from gliderhpc.observations.regions import wrapped_longitude
from gliderhpc.store_schema.schema import MISSION
from gliderhpc.version import __version__


@dataclass(frozen=True, eq=False)
class EstimatedDive:
    """One profile with its estimate.

    Attributes
    ----------
    record : ProfileRecord
        Depth, pitch, heading and fixes.
    track : GlideTrack or None
        Reconstructed flight; None if the record cannot be used.
    note : str
        Remarks on record and estimate, separated by semicolons.
    fault : str
        Reason why the record cannot be used; otherwise empty.
    """

    record: ProfileRecord
    track: GlideTrack | None
    note: str
    fault: str = ""


_SUMMARY = (
    "Currents averaged over the dives of an underwater glider, from GPS fixes and the displacement through the water "
    "computed from pitch, heading and depth with the glide-angle method, with standard deviations and covariance; "
    "corrected positions, speed through the water and angle of attack at every sample"
)


def currents_dataset(
    navigation: Navigation, dives: Sequence[EstimatedDive], polar: GlidePolar, errors: GlideErrors
) -> xr.Dataset:
    """Return the currents and the samples of all dives, with units and CF attributes.

    Parameters
    ----------
    navigation : Navigation
        Records of the mission, with the remarks on them.
    dives : sequence of EstimatedDive
        Profiles with their estimates, in order of time.
    polar : GlidePolar
        Drag and lift used.
    errors : GlideErrors
        Errors of the records and of the glide.
    """
    rows = [_row(dive.record, dive.track, dive.note) for dive in dives]
    table = {name: ("profile", [row[name] for row in rows], _attributes(name)) for name in rows[0] if name != "profile"}
    samples = [_samples(dive.record, dive.track) for dive in dives]
    series = {name: ("time", np.concatenate([part[name] for part in samples]), _SERIES[name]) for name in _SERIES}
    time = np.concatenate([part["time"] for part in samples])
    dataset = xr.Dataset(
        {**table, **series},
        coords={
            "profile": ("profile", np.array([row["profile"] for row in rows]), _attributes("profile")),
            "time": ("time", time, {"standard_name": "time", "long_name": "time of the sample", "axis": "T"}),
        },
        attrs=_global_attributes(navigation, polar, errors),
    )
    latitude, longitude, depth = (dataset[name].values for name in ("latitude", "longitude", "depth"))
    identifier = f"{Path(navigation.source).stem}_currents"
    dataset.attrs = {
        **discovery_attributes(_SUMMARY, time, latitude, longitude, depth, identifier),
        **dataset.attrs,
    }
    return with_content_types(dataset)


def _row(record: ProfileRecord, track: GlideTrack | None, note: str) -> dict[str, Any]:
    current = None if track is None else track.current
    fixes = dict(zip(_ENDS, (record.entry_fix, record.exit_fix) if track is None else track.fixes, strict=True))
    no_fix = Fix(np.datetime64("NaT", "ns"), np.nan, np.nan)
    row = {
        "profile": record.number,
        "message": note,
        "start_time": record.epoch,
        "max_depth": float(np.nanmax(record.depth)),
        "duration": float(record.time[-1]),
        "sample_count": np.int32(len(record.time)),
        **{name: value for end, fix in fixes.items() for name, value in fix_row(end, fix or no_fix).items()},
        **dict.fromkeys(_FROM_FIXES, np.nan),
        "glide_angle_masked_fraction": np.nan if track is None else track.motion.masked_fraction,
    }
    if current is not None:
        row |= current_row(current, "dac_{}", "dac_covariance")
    return row | surface_drift_row(record)


_ENDS = ("entry", "exit")

_FROM_FIXES = (
    "dac_north", "dac_east", "dac_north_std", "dac_east_std", "dac_covariance", "surface_drift_north",
    "surface_drift_east",
)  # fmt: skip
"""Columns that are unknown without a current or a drift at the surface."""


_SERIES: dict[str, dict[str, str]] = {
    "profile_number": {"long_name": "number of the profile", "units": "1"},
    "depth": {"standard_name": "depth", "long_name": "depth below the surface", "units": "m", "positive": "down"},
    "latitude": {
        "standard_name": "latitude", "units": "degrees_north",
        "long_name": "dead-reckoned latitude, from glide angle and depth-averaged current",
    },
    "longitude": {
        "standard_name": "longitude", "units": "degrees_east",
        "long_name": "dead-reckoned longitude, from glide angle and depth-averaged current",
    },
    "speed_through_water": {
        "standard_name": "platform_speed_wrt_sea_water", "units": "m s-1",
        "long_name": "speed through the water by pitch and depth rate",
    },
    "angle_of_attack": {"long_name": "steady angle of attack, negative on climbs", "units": "degree"},
}  # fmt: skip


def _samples(record: ProfileRecord, track: GlideTrack | None) -> dict[str, NDArray[np.generic]]:
    """Return values at the samples of a profile, NaN where there is no estimate."""
    count = len(record.time)
    values: dict[str, NDArray[np.generic]] = {
        "time": record.instants,
        "profile_number": np.full(count, record.number, dtype=np.int32),
        "depth": record.depth,
    }
    missing = np.full(count, np.nan)
    if track is None:
        return values | dict.fromkeys(("latitude", "longitude", "speed_through_water", "angle_of_attack"), missing)
    latitude, longitude = positions(track)
    on_points = {
        "latitude": latitude,
        "longitude": np.unwrap(longitude, period=360.0),
        "speed_through_water": track.speed,
        "angle_of_attack": np.degrees(track.angle_of_attack),
    }
    at = track.series.time
    for name, column in on_points.items():
        values[name] = np.interp(record.time, at, column, left=np.nan, right=np.nan)
    values["longitude"] = wrapped_longitude(np.asarray(values["longitude"], dtype=np.float64))
    return values


_STANDARD_NAMES = {
    "dac_north_std": "northward_sea_water_velocity standard_error",
    "dac_east_std": "eastward_sea_water_velocity standard_error",
    "surface_drift_north": "surface_northward_sea_water_velocity",
    "surface_drift_east": "surface_eastward_sea_water_velocity",
    "sample_count": "number_of_observations",
}
"""Standard names that the archive's columns do not have."""


def _attributes(name: str) -> dict[str, Any]:
    """Return the attributes of a column, as in the archive, with further standard names."""
    variable = MISSION["/"][name]
    # Units of times belong to the encoding.
    wanted = ("long_name", "standard_name") if variable.is_time else ("long_name", "standard_name", "units")
    attributes = variable.all_attributes()
    chosen = {key: attributes[key] for key in wanted if key in attributes}
    return chosen | ({"standard_name": _STANDARD_NAMES[name]} if name in _STANDARD_NAMES else {})


def _global_attributes(navigation: Navigation, polar: GlidePolar, errors: GlideErrors) -> dict[str, Any]:
    drag, lift = polar.platform.viscous.K_D0, polar.platform.viscous.K_L
    return {
        "Conventions": CONVENTIONS,
        "title": "Depth-averaged currents and positions of an underwater glider from the glide angle",
        "source": f"gliderhpc {__version__}, command currents, from {Path(navigation.source).name}",
        "history": f"made by gliderhpc {__version__}",
        "drag_over_lift": drag / lift,
        "drag_over_lift_relative_std": polar.deviation,
        "drag_over_lift_hull": polar.make,
        "declination_added": navigation.declination,
        "error_pitch_degree": float(np.degrees(errors.pitch_offset)),
        "error_course_degree": errors.course,
        "error_vertical_water_velocity": errors.vertical,
        "error_stationary": errors.stationary,
        "error_fix": errors.fix,
        "comment": "; ".join(navigation.remarks) or "none",
    }
