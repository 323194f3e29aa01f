"""Depth-averaged currents from pitch, heading, depth and GPS fixes alone: no ballast, calibration or compilation."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import xarray as xr

from gliderhpc.api.currents_dataset import EstimatedDive, currents_dataset
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.currents import describe_implausible_current
from gliderhpc.estimation.glide_currents import GlideErrors, GlideTrack, check_depth_rate, check_speed, glide_track
from gliderhpc.estimation.measured_glide import with_measured_attack
from gliderhpc.estimation.span_currents import with_span_currents
from gliderhpc.flight.glide_polar import GlidePolar, polar_of_hull, polar_of_make
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
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.observations.series import describe_false_samples
from gliderhpc.platform import Platform, read_platform
from gliderhpc.wording import most_frequent_reason, wanted_dataset


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
    """Estimate currents as `currents` does; an earlier result `out` in a folder of records is not read."""
    declination = None if declination is None else _degrees(declination)
    if errors is not None and not isinstance(errors, GlideErrors):
        raise InputError(f"errors: give GlideErrors, not a {type(errors).__name__}")
    navigation = navigation_of(records, declination, out)
    chosen = errors or GlideErrors(fix=navigation.fix_error)
    profiles = [navigation.record(number) for number in navigation.numbers]
    sound = [profile for profile in profiles if profile.number not in navigation.faults]
    polar, remarks = with_measured_attack(_polar(navigation, platform), sound)
    dives = [_estimate_dive(profile, navigation.faults, polar, chosen) for profile in profiles]
    tracks = [dive.track for dive in dives if dive.track is not None]
    if not tracks:
        raise InputError(
            f"{navigation.source}: no profile can be used; {most_frequent_reason(dive.fault for dive in dives)}"
        )
    dives = _with_span_currents(dives, navigation, chosen)
    remarks = (*navigation.remarks, *remarks, *check_speed(navigation.source, tracks))
    return currents_dataset(replace(navigation, remarks=remarks), dives, polar, chosen)


def _estimate_dive(
    record: ProfileRecord, faults: Mapping[int, str], polar: GlidePolar, errors: GlideErrors
) -> EstimatedDive:
    """Reconstruct the flight of a profile, or describe why its records cannot be used."""
    try:
        track = _track(record, faults, polar, errors)
    except ProfileError as error:
        return EstimatedDive(record, None, "; ".join([*record.notes, str(error)]), str(error))
    doubts = describe_false_samples(track.series)
    doubts += [] if track.current is None else describe_implausible_current(track.current.velocity)
    return EstimatedDive(record, track, "; ".join([*record.notes, *doubts]))


def _with_span_currents(
    dives: Sequence[EstimatedDive], navigation: Navigation, errors: GlideErrors
) -> list[EstimatedDive]:
    """Add the mean currents of dives without a fix between them, and remarks on them."""
    tracks, notes = with_span_currents([(dive.record, dive.track) for dive in dives], navigation, errors)
    return [
        replace(dive, track=track, note="; ".join(filter(None, [dive.note, notes.get(dive.record.number)])))
        for dive, track in zip(dives, tracks, strict=True)
    ]


def _track(record: ProfileRecord, faults: Mapping[int, str], polar: GlidePolar, errors: GlideErrors) -> GlideTrack:
    """Reconstruct the flight of a profile; `ProfileError` if its records cannot be used."""
    if record.number in faults:
        raise ProfileError(faults[record.number])
    check_depth_rate(record)
    return glide_track(record, polar.hulls, errors)


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
    is_table_or_mapping = hasattr(records, "columns") or isinstance(records, Mapping)
    if isinstance(records, Iterable) and not isinstance(records, str) and not is_table_or_mapping:
        paths = list(records)
    for path in paths:
        if not isinstance(path, str | Path):
            kind = type(path).__name__
            raise InputError(f"records: a {kind} cannot be used; give {wanted_dataset(path)}, a file or files")
    return [Path(path) for path in paths]


_NETCDF = (".nc", ".nc4")
"""Endings of netCDF files."""

_WITH_DECLINATION = ("slocum", "seaexplorer", "seaglider")
"""Kinds of records whose importers replace the declination in the files by a given one; OG1 is read directly."""


def _plain_files(path: Path, out: Path | None) -> list[Path]:
    """Return a file or a Zarr folder itself, or the netCDF files but `out` of any other folder."""
    if not path.is_dir() or any((path / mark).exists() for mark in ("zarr.json", ".zgroup")):
        return [path]
    entries = sorted(path.iterdir())
    chosen = [candidate for candidate in entries if _is_netcdf(candidate) and candidate.is_file()]
    chosen = [candidate for candidate in chosen if out is None or candidate.resolve() != out.resolve()]
    name_compressed(chosen, entries, _is_netcdf)
    if not chosen:
        raise InputError(f"{path}: contains neither netCDF files nor an instrument's records; give the files to read")
    return chosen


def _is_netcdf(path: Path) -> bool:
    return path.suffix.lower() in _NETCDF


def _polar(navigation: Navigation, platform: Platform | str | Path | None) -> GlidePolar:
    if platform is None:
        return polar_of_make(navigation.vehicle)
    return polar_of_hull(platform if isinstance(platform, Platform) else read_platform(platform))
