"""Ocean-model files in the two usual layouts, with a field that is known everywhere."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import netCDF4
import numpy as np

HYCOM_DEPTHS = (0, 2, 4, 6, 8, 10, 12, 15, 20, 25, 30, 35, 40, 45, 50, 60, 70, 80, 90, 100, 125, 150, 200, 250)
CMEMS_DEPTHS = (0.494025, 1.541375, 2.645669, 5.078224, 9.572997, 18.49556, 40.34405, 77.85385, 155.8507, 318.1274)


def linear(time, depth, latitude, longitude):
    """Velocity ``(..., 2)`` linear in hours since 2024-01-01, m, and degree, in whole mm/s at HYCOM's grid points."""
    north = 0.1 - 0.001 * depth + 0.25 * (latitude - 18.0) + 0.5 * (longitude - 115.0) + 0.004 * time
    east = -0.2 + 0.002 * depth - 0.5 * (latitude - 18.0) + 0.25 * (longitude - 115.0) - 0.002 * time
    return np.stack(np.broadcast_arrays(north, east), axis=-1)


@dataclass
class Model:
    """Content of a file; change it, then write it."""

    hours: np.ndarray = field(default_factory=lambda: np.arange(0.0, 49.0, 3.0))
    depths: np.ndarray = field(default_factory=lambda: np.array(HYCOM_DEPTHS, dtype=np.float64))
    latitudes: np.ndarray = field(default_factory=lambda: 17.6 + 0.04 * np.arange(26))
    longitudes: np.ndarray = field(default_factory=lambda: 114.6 + 0.08 * np.arange(14))
    velocity: Callable = linear
    missing: np.ndarray | None = None

    def values(self):
        """North and east at the grid points ``(t, d, j, i, 2)``, NaN where `missing` says so."""
        values = self.velocity(
            self.hours[:, None, None, None], self.depths[:, None, None], self.latitudes[:, None], self.longitudes
        )
        values = np.broadcast_to(values, (*self.shape, 2)).copy()
        if self.missing is not None:
            values[np.broadcast_to(self.missing, self.shape)] = np.nan
        return values

    @property
    def shape(self):
        return len(self.hours), len(self.depths), len(self.latitudes), len(self.longitudes)


def write_hycom(path: Path, model: Model, longitudes=lambda degrees: np.mod(degrees, 360.0)) -> Path:
    """Write the layout of HYCOM GOFS 3.1: packed integers, 0 to 360, and `tau`, whose unit is none."""
    with netCDF4.Dataset(path, "w", format="NETCDF3_64BIT_OFFSET") as file:
        file.setncatts({
            "institution": "Fleet Numerical Meteorology and Oceanography Center", "source": "HYCOM archive file",
            "history": "archv2ncdf3z", "field_type": "instantaneous", "Conventions": "CF-1.6 NAVO_netcdf_v1.1",
        })  # fmt: skip
        for name, size in zip(("time", "depth", "lat", "lon"), model.shape, strict=True):
            file.createDimension(name, size)
        _fill(
            file,
            "time",
            "f8",
            ("time",),
            model.hours + 24.0 * 8766,
            long_name="Valid Time",
            axis="T",
            units="hours since 2000-01-01 00:00:00",
            calendar="gregorian",
        )
        _fill(file, "tau", "f8", ("time",), 0.0 * model.hours, long_name="Tau", units="hours since analysis")
        _fill(
            file, "depth", "f8", ("depth",), model.depths, standard_name="depth", units="m", positive="down", axis="Z"
        )
        _fill(file, "lat", "f8", ("lat",), model.latitudes, standard_name="latitude", units="degrees_north", axis="Y")
        _fill(
            file,
            "lon",
            "f8",
            ("lon",),
            longitudes(model.longitudes),
            standard_name="longitude",
            units="degrees_east",
            modulo="360 degrees",
            axis="X",
        )
        values = model.values()
        for index, (name, standard) in enumerate((("water_v", "northward"), ("water_u", "eastward"))):
            attributes = {"standard_name": f"{standard}_sea_water_velocity", "units": "m/s"}
            packing = {"missing_value": np.int16(-30000), "scale_factor": 0.001, "add_offset": 0.0}
            variable = file.createVariable(name, "i2", ("time", "depth", "lat", "lon"), fill_value=np.int16(-30000))
            variable.setncatts({**attributes, **packing})
            variable.set_auto_maskandscale(False)
            packed = np.where(np.isnan(values[..., index]), -30.0, values[..., index]) / 0.001
            variable[:] = np.round(packed).astype(np.int16)
            bottom = file.createVariable(f"{name}_bottom", "i2", ("time", "lat", "lon"), fill_value=np.int16(-30000))
            bottom.setncatts({**attributes, **packing, "standard_name": f"{standard}_sea_water_velocity_at_bottom"})
    return path  # fmt: skip


def write_cmems(path: Path, model: Model, source: str = "MERCATOR GLORYS12V1") -> Path:
    """Write the layout of Copernicus Marine's global physics: floats, -180 to 180."""
    with netCDF4.Dataset(path, "w") as file:
        file.setncatts({
            "credit": "E.U. Copernicus Marine Service Information (CMEMS)", "source": source,
            "title": "daily mean fields from Global Ocean Physics Analysis and Forecast updated Daily",
            "Conventions": "CF-1.8",
        })  # fmt: skip
        for name, size in zip(("time", "depth", "latitude", "longitude"), model.shape, strict=True):
            file.createDimension(name, size)
        _fill(
            file,
            "time",
            "f8",
            ("time",),
            model.hours + 24.0 * 27028,
            standard_name="time",
            axis="T",
            units="hours since 1950-01-01",
            calendar="gregorian",
        )
        _fill(
            file, "depth", "f8", ("depth",), model.depths, standard_name="depth", units="m", positive="down", axis="Z"
        )
        _fill(
            file,
            "latitude",
            "f8",
            ("latitude",),
            model.latitudes,
            standard_name="latitude",
            units="degrees_north",
            axis="Y",
        )
        _fill(
            file,
            "longitude",
            "f8",
            ("longitude",),
            np.mod(model.longitudes + 180.0, 360.0) - 180.0,
            standard_name="longitude",
            units="degrees_east",
            axis="X",
        )
        values = model.values()
        for index, (name, standard) in enumerate((("vo", "northward"), ("uo", "eastward"))):
            variable = file.createVariable(
                name, "f8", ("time", "depth", "latitude", "longitude"), fill_value=9.96921e36
            )
            variable.setncatts({"standard_name": f"{standard}_sea_water_velocity", "units": "m s-1"})
            variable[:] = np.nan_to_num(values[..., index], nan=9.96921e36)
    return path  # fmt: skip


def _fill(file, name, kind, dims, values, **attributes):
    variable = file.createVariable(name, kind, dims)
    variable.setncatts(attributes)
    variable[:] = values
