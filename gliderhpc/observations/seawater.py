"""Seawater along a profile: in-situ density by TEOS-10 from a CTD record with spikes, gaps and pauses.

Samples of one dive or climb are gridded by pressure. Each cell takes their median, and the cells are median filtered
along the grid. Parts of a leg without samples are filled from the whole profile. Absolute Salinity and Conservative
Temperature are interpolated across gaps of limited width, and density is computed at the record's own pressure.

CTD samples that cannot be measurements of the water are not used: temperatures or salinities that the sea and lakes
never have. A sensor that is switched off, and a fill value that is not declared, give a salinity of exactly zero; rain
and melt water have a few thousandths. Salinities in kg/kg are a thousandth of the practical ones.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import gsw
import numpy as np
import numpy.typing as npt
import scipy

from gliderhpc.observations.records import Fix, FloatArray, ProfileRecord
from gliderhpc.observations.series import ProfileSeries

CELL = 2.0
"""Height of a cell of the grid (dbar)."""

FILTER = 5
"""Width of the running median, in cells that hold samples."""

MIN_CELLS = 10
"""Minimum number of cells with samples in a usable cast."""

MIN_BRIDGED_GAP = 20.0
"""Width of a gap (dbar) that is bridged at any pressure."""

GAP_SHARE = 1.0 / 3.0
"""Width of a gap that is also bridged, as a fraction of the pressure at its upper edge; gradients weaken with depth."""

MIN_TURN = 10.0
"""Change of pressure (dbar) on both sides of a turning point between legs."""

MAX_PRESSURE_OFFSET = 10.0
"""Maximum deviation (dbar), from the profile's median, of the difference of recorded pressure and pressure from depth;
a pressure that deviates more is not used."""

_NORMAL_LATITUDE = 45.0
_LEVEL = 1.0


class SeawaterMissingError(Exception):
    """Failure to determine the density of the water along a profile from its record."""


@dataclass(frozen=True, eq=False)
class _Cast:
    """Cells (n,) with samples: pressure (dbar), Absolute Salinity (g/kg), Conservative Temperature (degC)."""

    pressure: FloatArray
    salinity: FloatArray
    temperature: FloatArray

    def covers(self, levels: FloatArray) -> npt.NDArray[np.bool_]:
        """Mask (m,) of the levels that are not in a gap too wide to bridge."""
        if len(self.pressure) < MIN_CELLS:
            return np.zeros(len(levels), dtype=bool)
        after, last = np.searchsorted(self.pressure, levels), len(self.pressure) - 1
        above = np.where(after > 0, self.pressure[np.maximum(after - 1, 0)], levels)
        below = np.where(after <= last, self.pressure[np.minimum(after, last)], levels)
        return np.asarray(below - above <= np.maximum(MIN_BRIDGED_GAP, GAP_SHARE * above))

    def at(self, levels: FloatArray) -> FloatArray:
        """Absolute Salinity and Conservative Temperature (m, 2) at levels; constant beyond the ends of the cast."""
        return np.column_stack([np.interp(levels, self.pressure, v) for v in (self.salinity, self.temperature)])


def with_seawater(series: ProfileSeries, record: ProfileRecord) -> ProfileSeries:
    """Add the seawater along the record at the midpoints of a series' steps, or the reason why it is unknown.

    Parameters
    ----------
    series, record : ProfileSeries, ProfileRecord
        The same profile on the steps and as measured.

    Returns
    -------
    ProfileSeries
        Series with `seawater`, or with `without_seawater`.
    """
    try:
        return replace(series, seawater=seawater_on_steps(series, record))
    except SeawaterMissingError as error:
        return replace(series, without_seawater=str(error))


def seawater_on_steps(series: ProfileSeries, record: ProfileRecord) -> FloatArray:
    """Depth (m), in-situ density (kg/m3), in-situ temperature (degC) and pressure (dbar) ``(n, 4)`` on the steps.

    Parameters
    ----------
    series, record : ProfileSeries, ProfileRecord
        The same profile on the steps and as measured.

    Raises
    ------
    SeawaterMissingError
        The record has no plausible temperature or salinity, neither pressure nor a position, or too wide a gap.

    Notes
    -----
    Density is computed with the 75-term equation of TEOS-10 (Roquet et al. 2015), through gsw. Without a position,
    Reference Salinity replaces Absolute Salinity; in the open ocean they differ by at most 0.03 g/kg.
    """
    temperature, salinity = _sampled(record)
    depth = 0.5 * (series.measurements[:-1, 3] + series.measurements[1:, 3])
    pressure, sampled_at = _pressures(record, series.time[:-1] + 0.5 * series.step, depth)
    samples = _absolute(record, salinity, temperature, sampled_at)
    turns = _turning_points(pressure)
    edges = series.time[turns].copy()
    edges[[0, -1]] = -np.inf, np.inf
    legs = np.searchsorted(edges, record.time, side="right") - 1
    whole, water = _cast(samples), np.empty((len(depth), 2))
    for leg, (start, stop) in enumerate(pairwise(turns)):
        own = _cast(samples[legs == leg])
        water[start:stop] = _along(pressure[start:stop], own, whole)
    return np.column_stack([depth, water, pressure])


def _sampled(record: ProfileRecord) -> tuple[FloatArray, FloatArray]:
    """Temperature and practical salinity (m,), NaN where either is missing or implausible."""
    for name in ("temperature", "practical_salinity"):
        if getattr(record, name) is None or not np.isfinite(getattr(record, name)).any():
            raise SeawaterMissingError(f"no {name}")
    temperature, salinity = (np.asarray(v, dtype=np.float64) for v in (record.temperature, record.practical_salinity))
    fault = fault_of_water(temperature, salinity)
    if fault:
        raise SeawaterMissingError(fault)
    good = plausible_water(temperature, salinity)
    return np.where(good, temperature, np.nan), np.where(good, salinity, np.nan)


def _pressures(record: ProfileRecord, time: FloatArray, depth: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pressure on the steps (n,) and at the samples (m,): plausible recorded values, else from depth and latitude."""
    position = _position(record)
    latitude = _NORMAL_LATITUDE if position is None else position.latitude
    at_steps, at_samples = (
        np.asarray(gsw.p_from_z(-d, latitude)) for d in (depth, np.interp(record.time, time, depth))
    )
    recorded = np.full(len(record.time), np.nan) if record.pressure is None else record.pressure
    usable = _plausible(recorded - at_samples)
    if np.count_nonzero(usable) < MIN_CELLS:
        if position is None:
            raise SeawaterMissingError("neither pressure nor a GPS fix, whose latitude gives pressure from depth")
        return np.maximum(at_steps, 0.0), np.maximum(at_samples, 0.0)
    # Depth may come from another conversion or another sensor, so a straight line is fitted between the pressures.
    line = np.polyfit(at_samples[usable], recorded[usable], 1)
    at_samples = np.where(usable, recorded, np.polyval(line, at_samples))
    return np.maximum(np.polyval(line, at_steps), 0.0), np.maximum(at_samples, 0.0)


def _plausible(offset: FloatArray) -> npt.NDArray[np.bool_]:
    """Mask of the recorded pressures whose offset from the pressure of depth is usual in this profile."""
    known = np.isfinite(offset)
    return known & (np.abs(offset - np.median(offset[known])) <= MAX_PRESSURE_OFFSET) if known.any() else known


def _absolute(
    record: ProfileRecord, practical: FloatArray, temperature: FloatArray, pressure: FloatArray
) -> FloatArray:
    """Pressure, Absolute Salinity and Conservative Temperature (m, 3) of the samples, NaN where not measured."""
    position = _position(record)
    if position is None:
        salinity = gsw.SR_from_SP(practical)
    else:
        salinity = gsw.SA_from_SP(practical, pressure, position.longitude, position.latitude)
    return np.column_stack([pressure, salinity, gsw.CT_from_t(salinity, temperature, pressure)])


def _position(record: ProfileRecord) -> Fix | None:
    return record.entry_fix or record.exit_fix


def _turning_points(pressure: FloatArray) -> npt.NDArray[np.int64]:
    """First step of every leg, and the step after the last (k + 1,)."""
    found = [scipy.signal.find_peaks(sign * pressure, prominence=MIN_TURN)[0] for sign in (1.0, -1.0)]
    return np.array([0, *np.sort(np.concatenate(found)), len(pressure)], dtype=np.int64)


def _cast(samples: FloatArray) -> _Cast:
    """Grid samples (m, 3) by pressure: medians of the cells with samples, smoothed with a running median."""
    samples = samples[np.isfinite(samples).all(axis=1)]
    if not len(samples):
        return _Cast(*np.zeros((3, 0)))
    cells = np.floor(samples[:, 0] / CELL)
    order = np.argsort(cells, kind="stable")
    groups = np.split(samples[order], np.flatnonzero(np.diff(cells[order])) + 1)
    pressure, salinity, temperature = np.array([np.median(group, axis=0) for group in groups]).T
    # With mirrored ends, a spike in the first cell does not extend beyond it.
    return _Cast(pressure, *(scipy.ndimage.median_filter(v, FILTER, mode="mirror") for v in (salinity, temperature)))


def _along(pressure: FloatArray, own: _Cast, whole: _Cast) -> FloatArray:
    """In-situ density and temperature (n, 2) along one leg, from its own cast or else from the cast of the profile."""
    levels = np.arange(np.floor(pressure.min()), np.ceil(pressure.max()) + 2.0 * _LEVEL, _LEVEL)
    here, anywhere = own.covers(levels), whole.covers(levels)
    lacking = levels[~(here | anywhere)]
    if len(lacking):
        raise SeawaterMissingError(f"no usable temperature and practical_salinity near {lacking[0]:.0f} dbar")
    values = np.empty((len(levels), 2))
    for cast, chosen in ((whole, ~here), (own, here)):
        if chosen.any():
            values[chosen] = cast.at(levels[chosen])
    density = gsw.rho(values[:, 0], values[:, 1], levels)
    temperature = gsw.t_from_CT(values[:, 0], values[:, 1], levels)
    return np.column_stack([np.interp(pressure, levels, v) for v in (density, temperature)])


# Samples that cannot be measurements of the water

PLAUSIBLE_TEMPERATURE = (-2.6, 45.0)
PLAUSIBLE_SALINITY = (0.0, 42.0)
"""Plausible ranges (degC; practical salinity); samples outside, and a salinity of exactly zero, count as missing."""

MAX_SALINITY_IN_KG = 0.045
"""Practical salinity up to which that of a whole profile is suspected to be in kg/kg: the sea has up to 0.042 kg/kg,
and the lakes in which gliders fly have a practical salinity of 0.05 and more."""

_WHOLE_PROFILE = 0.95
"""Share of the samples that count as the whole profile, since a record contains spikes."""


def plausible_water(temperature: FloatArray, salinity: FloatArray) -> npt.NDArray[np.bool_]:
    """Mask ``(m,)`` of the samples with a plausible temperature (degC) and practical salinity, ``(m,)`` each."""
    return _is_plausible_temperature(temperature) & _is_plausible_salinity(salinity)


def _is_plausible_temperature(temperature: FloatArray) -> npt.NDArray[np.bool_]:
    """Mask of the temperatures in the plausible range; NaN compares false, as it is missing."""
    low, high = PLAUSIBLE_TEMPERATURE
    return np.asarray((temperature >= low) & (temperature <= high))


def _is_plausible_salinity(salinity: FloatArray) -> npt.NDArray[np.bool_]:
    """Mask of the practical salinities in the plausible range, without zero."""
    low, high = PLAUSIBLE_SALINITY
    return np.asarray((salinity > low) & (salinity <= high))


def fault_of_water(temperature: FloatArray, salinity: FloatArray) -> str | None:
    """Describe why the samples of a profile cannot be measurements of its water; None if some are.

    Parameters
    ----------
    temperature, salinity : (m,) array
        Temperature (degC) and practical salinity; NaN where missing, each with some value.

    Returns
    -------
    str or None
        Name of the variable, its values and the remedy.
    """
    warm, salty = _is_plausible_temperature(temperature), _is_plausible_salinity(salinity)
    if not warm.any():
        low, high = PLAUSIBLE_TEMPERATURE
        return (
            f"temperature is {_extent(temperature)} degC, outside {low:g} to {high:g} degC; if it is in kelvin, "
            "convert it to degC"
        )
    if not salty.any():
        return _fault_of_salinity(salinity)
    if np.quantile(salinity[salty], _WHOLE_PROFILE) <= MAX_SALINITY_IN_KG:
        return (
            f"practical_salinity is {_extent(salinity[salty])}, fresher than nearly any lake, as if it was in kg/kg; "
            "multiply it by 1000"
        )
    if not (warm & salty).any():
        return "no sample with both temperature and practical_salinity in their plausible range"
    return None


def _fault_of_salinity(salinity: FloatArray) -> str:
    """Describe practical salinities that are all implausible."""
    low, high = PLAUSIBLE_SALINITY
    if not salinity[np.isfinite(salinity)].any():
        return "practical_salinity is 0 in all samples, as if it was not measured; correct it or mark it missing (NaN)"
    return (
        f"practical_salinity is {_extent(salinity)}, outside its plausible range, {low:g} to {high:g}; correct it or "
        "mark it missing (NaN)"
    )


def _extent(values: FloatArray) -> str:
    """Format the least and the greatest of the known values; a single number if they are equal."""
    low, high = (f"{limit:.4g}" for limit in (np.nanmin(values), np.nanmax(values)))
    return low if low == high else f"between {low} and {high}"
