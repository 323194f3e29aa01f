"""Currents of a mission as a CF netCDF file for assimilation centres: one profile for each dive, with depth bins.

Depth-averaged currents have CF standard names and are called ``u`` and ``v``, as in the glider data centres; errors and
covariance are included. The shear-sensitive part has no standard name, since it is not a velocity of the water.
"""

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.current import adopted_current
from gliderhpc.archive.mission import archive_errors, open_for_reading
from gliderhpc.archive.profile import ADJOINT, SMOOTHED, read_profile_data
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError
from gliderhpc.estimation.current_errors import CurrentErrors, current_uncertainty
from gliderhpc.observations.files.discovery import CONVENTIONS, discovery_attributes, with_content_types
from gliderhpc.observations.times import epoch_seconds
from gliderhpc.output_files import output_file
from gliderhpc.report.exports import check_export_path, unfit_profiles
from gliderhpc.report.maps import dive_midpoints
from gliderhpc.store_schema.location import Location
from gliderhpc.studies.archived import outdated_because, platform_of, settings_of
from gliderhpc.studies.library.tracks import CURRENTS as STUDY
from gliderhpc.studies.library.tracks import archived_drift
from gliderhpc.version import __version__
from gliderhpc.wording import counted

log = logging.getLogger("gliderhpc.export")

Array = NDArray[np.float64]

_EPOCH = "seconds since 1970-01-01T00:00:00Z"
_ESTIMATES = (ADJOINT, SMOOTHED)
_ALONG = {"u": "east", "v": "north"}
_NOT_ABSOLUTE = (
    "the part of the current across the hull that acts on the yaw moment: its rate of change along the path, "
    "band-limited, a lower bound of the amplitude; neither this part nor its sum with the depth-averaged current is "
    "the absolute profile"
)


def export_currents(
    archive: Location, out: str | Path, *, described: Mapping[str, str] | None = None, overwrite: bool = False
) -> tuple[list[int], dict[int, str]]:
    """Write the currents of an archive, from its study ``currents``.

    Parameters
    ----------
    archive : str or Path
        A finished archive with the group ``currents``.
    out : str or Path
        The netCDF file to write; it appears when it is complete.
    described : mapping of str to str, optional
        Global attributes (``creator_name`` ...), which take precedence over those of the archive.
    overwrite : bool
        Replace an existing file.

    Returns
    -------
    profiles : list of int
        Numbers of the exported profiles.
    left_out : dict of int to str
        Excluded profiles with the reason.

    Raises
    ------
    InputError
        The archive is not finished or has no such group or no current, or the file cannot be written.
    """
    out = Path(out)
    check_export_path(archive, out, overwrite)
    with archive_errors(archive), open_for_reading(archive) as tree:
        left_out = unfit_profiles(archive, tree)
        if STUDY not in tree.children:
            raise InputError(f"{archive}: has no group {STUDY}; make it with `gliderhpc analyze {archive} {STUDY}`")
        table, study = tree.to_dataset().load(), tree[STUDY].to_dataset().drop_dims("record").load()
        adopted = _with_adopted_currents(tree, table, study)
        known = np.isfinite(adopted["current_north"].values)
        numbers = table["profile"].values[~known].tolist()
        studied = study.attrs.get("profiles", numbers)
        for number in numbers:
            left_out.setdefault(number, _NO_CURRENT if number in studied else _NOT_STUDIED)
        if not known.any():
            raise InputError(f"{archive}: no profile has a current, so there is nothing to export")
        content = _content(table.isel(profile=known), adopted.isel(profile=known))
        content.attrs = {**_attributes(tree, study, content), **(described or {})}
        if outdated := outdated_because(tree, STUDY):
            log.warning("%s: the study %s was %s; run it again before the export", archive, STUDY, outdated)
    _write(content, out, overwrite)
    return content["profile"].values.tolist(), left_out


_NO_CURRENT = "no depth-averaged current: a fix before or after the dive is missing"
_NOT_STUDIED = f"study {STUDY} was run without this profile; run it again for all"


def _with_adopted_currents(tree: Archive, table: xr.Dataset, study: xr.Dataset) -> xr.Dataset:
    """Replace the study's current and error ellipse with the smoother's where that is usable.

    The error terms of the ellipse are those of the study, from a budget if one was used.
    """
    smoothed = adopted_current(table).smoothed & np.isfinite(study["current_north"].values)
    estimate = str(study.attrs.get("estimate", ADJOINT))
    adopted = study.assign(current_estimate=("profile", np.full(len(smoothed), estimate, dtype=object)))
    stored, settings = study.attrs.get("errors"), settings_of(tree).current
    by_hull = bool(study.attrs.get("by_hull", settings.by_hull))
    errors = settings.errors(platform_of(tree)) if stored is None else CurrentErrors.model_validate(stored)
    for index in np.flatnonzero(smoothed):
        data = read_profile_data(tree, int(table["profile"][index]))
        drift = archived_drift(tree, data, SMOOTHED, by_hull=by_hull)
        if drift is not None:
            covariance = current_uncertainty(drift, errors).covariance
            values = (*drift.velocity, *np.sqrt(np.diag(covariance)), covariance[0, 1], SMOOTHED)
            for name, value in zip(_OF_CURRENT, values, strict=True):
                adopted[name].values[index] = value
    return adopted


_OF_CURRENT = (
    "current_north",
    "current_east",
    "current_north_std",
    "current_east_std",
    "current_covariance",
    "current_estimate",
)


def _content(table: xr.Dataset, study: xr.Dataset) -> xr.Dataset:
    bounds = np.column_stack([epoch_seconds(table["entry_time"].values), epoch_seconds(table["exit_time"].values)])
    latitude, longitude = dive_midpoints(table).T
    content = xr.Dataset(
        {
            "time_bounds": (("profile", "bounds"), bounds),
            "max_depth": ("profile", table["max_depth"].values,
                          {"long_name": "greatest depth of the dive", "units": "m", "positive": "down"}),
            "converged_fraction": ("profile", table["converged_fraction"].values,
                                   {"long_name": "share of the estimate's windows that converged", "units": "1"}),
        },
        coords={
            "profile": ("profile", table["profile"].values.astype(np.int32),
                        {"long_name": "number of the dive", "cf_role": "profile_id"}),
            "time": ("profile", bounds.mean(axis=1),
                     {"standard_name": "time", "long_name": "middle between the fixes before and after the dive",
                      "units": _EPOCH, "calendar": "gregorian", "bounds": "time_bounds", "axis": "T"}),
            "latitude": ("profile", latitude,
                         {"standard_name": "latitude", "long_name": "middle of the geodesic between the two fixes",
                          "units": "degrees_north"}),
            "longitude": ("profile", longitude,
                          {"standard_name": "longitude", "long_name": "middle of the geodesic between the two fixes",
                           "units": "degrees_east"}),
        },
    )  # fmt: skip
    return content.assign(_averaged(study) | _by_depth(study)).assign_coords(_depths(study))


def _averaged(study: xr.Dataset) -> dict[str, tuple[str, Any, dict[str, Any]]]:
    """Return the depth-averaged current with its errors."""
    variables: dict[str, tuple[str, Any, dict[str, Any]]] = {}
    for name, along in _ALONG.items():
        variables[name] = (
            "profile",
            study[f"current_{along}"].values,
            {
                "standard_name": f"{along}ward_sea_water_velocity",
                "units": "m s-1",
                "long_name": f"depth-averaged current to the {along}",
                "cell_methods": "time: mean",
                "ancillary_variables": f"{name}_error uv_covariance current_estimate",
                "comment": "mean over the dive from the surface to max_depth, every depth weighted by the time spent "
                "there",
            },
        )
        variables[f"{name}_error"] = (
            "profile",
            study[f"current_{along}_std"].values,
            {
                "standard_name": f"{along}ward_sea_water_velocity standard_error",
                "units": "m s-1",
                "long_name": f"standard deviation of {name}",
            },
        )
    codes = [list(_ESTIMATES).index(name) for name in study["current_estimate"].values.tolist()]
    variables["current_estimate"] = (
        "profile",
        np.array(codes, dtype=np.int8),
        {
            "long_name": "method that gave u and v",
            "units": "1",
            "flag_values": np.arange(len(_ESTIMATES), dtype=np.int8),
            "flag_meanings": " ".join(_ESTIMATES),
            "comment": "the smoother's displacement through the water where it is usable, else that of the study's "
            "estimate",
        },
    )
    variables["uv_covariance"] = (
        "profile",
        study["current_covariance"].values,
        {"long_name": "covariance of u and v", "units": "m2 s-2"},
    )
    return variables


def _by_depth(study: xr.Dataset) -> dict[str, tuple[tuple[str, str], Array, dict[str, str]]]:
    """Return the shear-sensitive part by depth, from dive and climb together, with its errors."""
    dims, variables = ("profile", "depth"), {}
    for name, along in _ALONG.items():
        noise = study[f"both_shear_noise_std_{along}"].values
        error = np.hypot(study[f"both_shear_coefficient_std_{along}"].values, np.nan_to_num(noise))
        variables[f"{name}_shear_sensitive"] = (
            dims,
            study[f"both_shear_{along}"].values,
            {
                "long_name": f"shear-sensitive part of the current to the {along}",
                "units": "m s-1",
                "cell_methods": "depth: mean",
                "comment": _NOT_ABSOLUTE,
                "ancillary_variables": f"{name}_shear_sensitive_error shear_sensitive_count",
            },
        )
        variables[f"{name}_shear_sensitive_error"] = (
            dims,
            error,
            {
                "long_name": f"standard deviation of {name}_shear_sensitive",
                "units": "m s-1",
                "comment": "by the moment coefficients"
                + ("" if np.isnan(noise).all() else " and the yaw moment's noise")
                + "; unknown terms are not included",
            },
        )
    variables["shear_sensitive_count"] = (
        dims,
        study["both_count"].values.astype(np.int32),
        {"long_name": "records in the bin", "units": "1", "standard_name": "number_of_observations"},
    )
    return variables


def _depths(study: xr.Dataset) -> dict[str, tuple[object, Array, dict[str, str]]]:
    height = float(study.attrs["settings"]["bin"])
    edges = height * np.arange(study.sizes["bin"] + 1.0)
    return {
        "depth": ("depth", 0.5 * (edges[1:] + edges[:-1]),
                  {"standard_name": "depth", "long_name": "middle of the bin", "units": "m", "positive": "down",
                   "axis": "Z", "bounds": "depth_bounds"}),
        "depth_bounds": (("depth", "bounds"), np.column_stack([edges[:-1], edges[1:]]), {}),
    }  # fmt: skip


_SUMMARY = (
    "Currents averaged over the dives of an underwater glider, from the fixes before and after each dive and the "
    "displacement through the water from its flight model, with standard deviations and covariance; and, by depth, "
    "the part of the current across the hull that acts on its yaw moment"
)


def _attributes(tree: Archive, study: xr.Dataset, content: xr.Dataset) -> dict[str, Any]:
    known = tree.attrs
    outdated = outdated_because(tree, STUDY)
    doubt = f" The shear-sensitive part was {outdated}." if outdated else ""
    time = (1e9 * content["time"].values).astype("int64").astype("datetime64[ns]")
    return {
        "Conventions": CONVENTIONS,
        **discovery_attributes(
            _SUMMARY,
            time,
            content["latitude"].values,
            content["longitude"].values,
            content["depth"].values,
            f"{str(known.get('mission') or 'mission').replace(' ', '_')}_currents",
        ),
        "featureType": "profile",
        "title": "Currents from an underwater glider's attitude, depth, actuators and fixes",
        "source": f"gliderhpc {known.get('software_version')} on {known.get('observations')}, sha256 "
        f"{known.get('observations_digest')}; shear-sensitive part: {study.attrs.get('estimate')} estimate",
        "history": f"exported by gliderhpc {__version__}",
        "mission": str(known.get("mission") or "unknown"),
        "platform": str(known["platform"]["name"]),
        "comment": "u and v are the mean velocity over the ground, from fix to fix, of the water that the glider flew "
        f"through. {counted(content.sizes['profile'], 'dive')}.{doubt}",
    }


_NEVER_MISSING = ("time", "latitude", "longitude", "depth", "time_bounds", "depth_bounds")
"""Coordinates and their bounds, for which CF forbids a fill value (sections 2.5.1 and 7.1)."""


def _write(content: xr.Dataset, out: Path, overwrite: bool) -> None:
    for name in _NEVER_MISSING:
        # None keeps xarray from adding its default fill value for floats.
        content[name].encoding["_FillValue"] = None
    with_content_types(content)
    with output_file(out, overwrite=overwrite) as aside:
        content.to_netcdf(aside, format="NETCDF4", engine="netcdf4")
