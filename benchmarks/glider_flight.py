"""The steady model of gliderflight (Merckelbach et al. 2010, 2019; extra ``bench``) on the samples of a study.

It knows no roll and no turning, solves for the angle of attack in a table of its own, and is upward positive.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gsw
import numpy as np
import xarray as xr

from benchmarks.peers.base import require
from gliderhpc.archive.profile import ProfileData
from gliderhpc.platform import CUBIC_CENTIMETRE, Platform
from gliderhpc.studies.library.vertical_velocity import VerticalVelocity

Array = np.ndarray

SURFACE = 0.1
"""Reference surface of its coefficients, m2."""

COMPRESSIBILITY = 5e-10
"""Its default compressibility of the hull, 1/Pa."""

FITTED = ("mg", "Cd0", "epsilon")
"""Fitted parameters: mass, drag, compressibility."""

_BAR_IN_DBAR = 0.1


@dataclass(frozen=True, eq=False)
class EstablishedSolution:
    """Apply the established model to n samples: depth rate, positive down, and speed through the water, m/s."""

    depth_rate: Array
    speed: Array


def with_our_weight(platform: Platform, found: VerticalVelocity) -> EstablishedSolution:
    """Its balance with our coefficients and net weight: the remaining differences are roll, turning and its table."""
    density = platform.buoyancy.water_density
    model = _model(platform, density)
    model.define(Vg=platform.mass.total / density, mg=platform.mass.total, epsilon=0.0)
    # All of our net weight is given as ballast: g rho Vbp = -W.
    volume = -found.weight / (density * model.G) / CUBIC_CENTIMETRE
    n = len(volume)
    return _solved(model, {
        "time": np.arange(float(n)), "pressure": np.zeros(n), "pitch": found.attitude.pitch, "buoyancy_change": volume,
        "density": np.full(n, density), "dhdt": np.zeros(n),
    })  # fmt: skip


def fitted(
    platform: Platform, profiles: Sequence[tuple[ProfileData, VerticalVelocity]], water: Sequence[Array]
) -> tuple[list[EstablishedSolution], dict[str, float]]:
    """Its balance as its users fit it: mass, drag and compressibility to the depth rate, in water of measured density.

    Lift and induced drag are those of the platform.

    Parameters
    ----------
    platform : Platform
        The hull, uncalibrated numbers of which are only the lift and the induced drag.
    profiles : sequence
        Archived profiles with their vertical velocities.
    water : sequence of (n,) arrays
        In-situ density at their samples, kg/m3.
    """
    model = _model(platform, float(np.mean(np.concatenate(water))))
    model.define(Vg=platform.mass.total / model.RHO0, mg=platform.mass.total, epsilon=COMPRESSIBILITY)
    inputs = [_inputs(data, found, density) for (data, found), density in zip(profiles, water, strict=True)]
    joined = {name: np.concatenate([one[name] for one in inputs]) for name in inputs[0]}
    model.set_input_data(**joined)
    model.set_mask(~np.isfinite(joined["dhdt"]))
    values = model.calibrate(*FITTED)
    model.define(**values)
    return [_solved(model, one) for one in inputs], values


def density_at_samples(dataset: xr.Dataset, data: ProfileData, found: VerticalVelocity) -> Array:
    """In-situ density (n,) by TEOS-10 at the samples, from an observation file's own CTD, kg/m3.

    Latitude and longitude are those of the first fix: over a mission they matter by less than 0.01 kg/m3.
    """
    time = (dataset["time"].values - data.epoch) / np.timedelta64(1, "s")
    at = data.record_time[found.record]
    own = (time >= at[0] - 600.0) & (time <= at[-1] + 600.0)
    values = [dataset[name].values[own] for name in ("temperature", "practical_salinity")]
    known = np.isfinite(values).all(axis=0)
    temperature, salinity = (np.interp(at, time[own][known], value[known]) for value in values)
    longitude, latitude = (float(dataset[f"fix_{name}"].values[0]) for name in ("longitude", "latitude"))
    pressure = gsw.p_from_z(-found.attitude.depth, latitude)
    absolute = gsw.SA_from_SP(salinity, pressure, longitude, latitude)
    return np.asarray(gsw.rho(absolute, gsw.CT_from_t(absolute, temperature, pressure), pressure))


def _model(platform: Platform, density: float) -> Any:
    require("gliderflight")
    from gliderflight import SteadyStateCalibrate

    viscous = platform.viscous
    to_coefficient = 2.0 / (density * SURFACE)
    model = SteadyStateCalibrate(rho0=density)
    model.define(S=SURFACE, aw=0.0, ah=to_coefficient * viscous.K_L, Cd1=to_coefficient * viscous.K_D)
    model.define(Cd0=to_coefficient * viscous.K_D0)
    return model


def _inputs(data: ProfileData, found: VerticalVelocity, density: Array) -> dict[str, Array]:
    pressure = gsw.p_from_z(-found.attitude.depth, 45.0) * _BAR_IN_DBAR
    return {
        "time": data.record_time[found.record],
        "pressure": pressure,
        "pitch": found.attitude.pitch,
        "buoyancy_change": data.controls[found.record, 2],
        "density": density,
        "dhdt": -found.measured,
    }


def _solved(model: Any, inputs: dict[str, Array]) -> EstablishedSolution:
    result = model.solve(dict(inputs))
    return EstablishedSolution(-np.asarray(result.w), np.asarray(result.U))
