"""Depth-averaged currents from pitch, heading, depth and GPS fixes alone: no ballast, calibration or compilation."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.currents import current_row, describe_implausible_current, fix_row, surface_drift_row
from gliderhpc.estimation.glide_currents import (
    GlideErrors,
    GlideTrack,
    check_depth_rate,
    check_speed,
    glide_track,
    positions,
)
from gliderhpc.estimation.measured_glide import with_measured_attack
from gliderhpc.flight.glide_polar import GlidePolar, polar_of_hull, polar_of_make
from gliderhpc.observations.files.discovery import CONVENTIONS, discovery_attributes, with_content_types
from gliderhpc.observations.files.foreign import name_compressed
from gliderhpc.observations.files.tables import is_table, read_table
from gliderhpc.observations.navigation.records import (
    Navigation,
    merge_navigation,
    open_part,
    read_navigation,
    read_part,
    with_dives,
)
from gliderhpc.observations.records import Fix, ProfileRecord
from gliderhpc.observations.regions import wrapped_longitude
from gliderhpc.observations.series import describe_false_samples
from gliderhpc.platform import Platform, read_platform
from gliderhpc.store_schema.schema import MISSION
from gliderhpc.version import __version__
from gliderhpc.wording import most_frequent_reason

Array = NDArray[np.float64]


def currents(
    records: xr.Dataset | str | Path | Iterable[str | Path],
    *,
    platform: Platform | str | Path | None = None,
    declination: float | None = None,
    errors: GlideErrors | None = None,
) -> xr.Dataset:
    """Estimate depth-averaged currents and positions under water without a flight model.

    Parameters
    ----------
    records : xarray.Dataset, path, or paths
        Depth (or pressure), pitch, heading and positions, under the names of the observation format, OG1, pyglider or
        CF; or an instrument's own files, which are imported first.
    platform : Platform, str or Path, optional
        Hull whose drag and lift are used unchanged; by default those of the vehicle's make.
    declination : float, optional
        Declination to add to a magnetic heading, instead of the one in the file, degree. It is not added to a heading
        that refers to true north according to its file.
    errors : GlideErrors, optional
        Errors of pitch, compass, fixes and water.

    Returns
    -------
    xarray.Dataset
        One row per ``profile``: fixes, ``dac_north`` and ``dac_east`` (m s-1) with standard deviations and covariance,
        and the drift at the surface, under the archive's names. Along ``time``, for the samples of the profiles:
        ``latitude`` and ``longitude`` under water, ``speed_through_water`` (m s-1), ``angle_of_attack`` (degree).

    Raises
    ------
    InputError
        An input that the currents require is missing (the message names it), or no profile can be used.

    Notes
    -----
    Speed is ``|v_z / sin(xi)|`` with glide angle ``xi = pitch - angle of attack`` (eq. 15). The current is that of
    eqs. 39 and 40. The covariance includes errors of the drag-to-lift ratio, pitch, compass, the water's vertical
    velocity and fixes, and the time adrift at the surface.
    """
    return estimate_currents(records, platform=platform, declination=declination, errors=errors)


def estimate_currents(
    records: xr.Dataset | str | Path | Iterable[str | Path],
    *,
    platform: Platform | str | Path | None,
    declination: float | None,
    errors: GlideErrors | None = None,
    out: Path | None = None,
) -> xr.Dataset:
    """Estimate currents as `currents` does, with error messages in the words of the command line.

    An earlier result `out` in a folder of records is not read.
    """
    declination = None if declination is None else _degrees(declination)
    if errors is not None and not isinstance(errors, GlideErrors):
        raise InputError(f"errors: give GlideErrors, not a {type(errors).__name__}")
    navigation = navigation_of(records, declination, out)
    chosen = errors or GlideErrors(fix=navigation.fix_error)
    usable = [navigation.record(number) for number in navigation.numbers]
    unusable = navigation.faults
    sound = [record for record in usable if record.number not in unusable]
    polar, remarks = with_measured_attack(_polar(navigation, platform), sound)
    navigation = replace(navigation, remarks=(*navigation.remarks, *remarks))
    tracks: list[GlideTrack | None] = []
    notes: list[str] = []
    faults: list[str] = []
    for record in usable:
        try:
            track = _track(record, unusable, polar, chosen)
        except ProfileError as error:
            tracks.append(None)
            faults.append(str(error))
            notes.append("; ".join([*record.notes, str(error)]))
            continue
        tracks.append(track)
        doubts = describe_false_samples(track.series)
        doubts += [] if track.current is None else describe_implausible_current(track.current.velocity)
        notes.append("; ".join([*record.notes, *doubts]))
    if not any(tracks):
        raise InputError(f"{navigation.source}: no profile can be used; {most_frequent_reason(faults)}")
    doubt = check_speed(navigation.source, [track for track in tracks if track is not None])
    navigation = replace(navigation, remarks=(*navigation.remarks, *doubt))
    return _dataset(navigation, usable, tracks, notes, polar, chosen)


def _track(record: ProfileRecord, faults: Mapping[int, str], polar: GlidePolar, errors: GlideErrors) -> GlideTrack:
    """Reconstruct the flight of a profile; `ProfileError` if its records cannot be used."""
    if record.number in faults:
        raise ProfileError(faults[record.number])
    check_depth_rate(record)
    return glide_track(record, polar.hulls, errors)


_SUMMARY = (
    "Currents averaged over the dives of an underwater glider, from GPS fixes and the displacement through the water "
    "computed from pitch, heading and depth with the glide-angle method, with standard deviations and covariance; "
    "corrected positions, speed through the water and angle of attack at every sample"
)


def navigation_of(
    records: xr.Dataset | str | Path | Iterable[str | Path],
    declination: float | None = None,
    out: Path | None = None,
) -> Navigation:
    """Read the navigation of records of any kind but `out`; an instrument's own files are imported first."""
    if isinstance(records, xr.Dataset):
        return read_navigation(records, declination=declination)
    if isinstance(records, xr.DataTree | xr.DataArray):
        raise InputError(f"records: a {type(records).__name__} cannot be used; give an xarray.Dataset, a file or files")
    paths = _paths(records)
    if not paths:
        raise InputError("records: none given; give a file, files or a Dataset")
    # The importers load libraries that a plain file does not need.
    from gliderhpc.api.records import import_records, is_instrument_file, kind_of

    if any(is_instrument_file(path) for path in paths):
        if declination is not None and kind_of(paths) in _WITH_DECLINATION:
            return read_navigation(import_records(paths, declination=declination), str(paths[0]))
        return read_navigation(import_records(paths), str(paths[0]), declination)
    parts = [
        read_part(read_table(file), str(file), declination) if is_table(file) else open_part(file, declination)
        for path in paths
        for file in _plain_files(path, out)
    ]
    return with_dives(merge_navigation(parts))


_MAX_DECLINATION = 180.0


def _degrees(declination: Any) -> float:
    """Return a declination as a number; `InputError` if it is none."""
    try:
        number = float("nan") if isinstance(declination, bool | str) else float(declination)
    except (TypeError, ValueError):
        number = float("nan")
    if not abs(number) <= _MAX_DECLINATION:
        raise InputError(f"declination={declination!r}: give a number of degrees from -180 to 180")
    return number


def _paths(records: str | Path | Iterable[str | Path]) -> list[Path]:
    """Return the path of a file, or those of several; `InputError` for anything else, such as a table."""
    paths: list[Any] = [records]
    if isinstance(records, Iterable) and not isinstance(records, str) and not hasattr(records, "columns"):
        paths = list(records)
    for path in paths:
        if not isinstance(path, str | Path):
            kind = type(path).__name__
            raise InputError(f"records: a {kind} cannot be used; give an xarray.Dataset, a file or files")
    return [Path(path) for path in paths]


_NETCDF = (".nc", ".nc4")
"""Endings of netCDF files."""

_WITH_DECLINATION = ("slocum", "seaexplorer", "seaglider")
"""Kinds of records whose importers replace the declination in the files by a given one; OG1 is read directly."""


def _plain_files(path: Path, out: Path | None) -> list[Path]:
    """Return a file or a Zarr folder itself, or the netCDF files but `out` of any other folder."""
    if not path.is_dir() or any((path / mark).exists() for mark in ("zarr.json", ".zgroup")):
        return [path]
    held = sorted(path.iterdir())
    chosen = [candidate for candidate in held if _is_netcdf(candidate) and candidate.is_file()]
    chosen = [candidate for candidate in chosen if out is None or candidate.resolve() != out.resolve()]
    name_compressed(chosen, held, _is_netcdf)
    if not chosen:
        raise InputError(f"{path}: contains neither netCDF files nor an instrument's records; give the files to read")
    return chosen


def _is_netcdf(path: Path) -> bool:
    return path.suffix.lower() in _NETCDF


def _polar(navigation: Navigation, platform: Platform | str | Path | None) -> GlidePolar:
    if platform is None:
        return polar_of_make(navigation.vehicle)
    return polar_of_hull(platform if isinstance(platform, Platform) else read_platform(platform))


def _dataset(
    navigation: Navigation,
    records: Sequence[ProfileRecord],
    tracks: Sequence[GlideTrack | None],
    notes: Sequence[str],
    polar: GlidePolar,
    errors: GlideErrors,
) -> xr.Dataset:
    rows = [_row(record, track, note) for record, track, note in zip(records, tracks, notes, strict=True)]
    table = {name: ("profile", [row[name] for row in rows], _attributes(name)) for name in rows[0] if name != "profile"}
    samples = [_samples(record, track) for record, track in zip(records, tracks, strict=True)]
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
    fixes = {"entry": record.entry_fix, "exit": record.exit_fix}
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
    latitude, longitude = positions(record, track)
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
