"""Estimate how much the thermal lag of the conductivity cell, which is not corrected, changes buoyancy and depth rate.

Usage: ``python -m benchmarks.thermal_lag OBSERVATIONS.nc [...]``, files in the observation format with a CTD. Writes
``docs/thermal-lag.md``.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import gsw
import numpy as np
from numpy.typing import NDArray

import gliderhpc as gh
from gliderhpc.errors import ProfileError
from gliderhpc.estimation.resample import resample, sampling_intervals
from gliderhpc.findings.formatting import markdown
from gliderhpc.observations import ProfileRecord, open_observations
from gliderhpc.observations.intervals import longest_bridged
from gliderhpc.observations.seawater import SeawaterMissingError, seawater_on_steps
from gliderhpc.platform import Platform

GRAVITY = 9.81
FLOWS = (0.4, 0.1)
"""Speed of the water in the cell, m/s: pumped, and flushed by the motion of the glider alone."""
STEP = 2.0
TEMPLATE = Path(__file__).with_suffix(".md")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "thermal-lag.md"

Array = NDArray[np.float64]


def error_and_time(flow: float) -> tuple[float, float]:
    """Initial fluid thermal anomaly, and relaxation time (s), of a cell by the speed of the water in it (m/s).

    The fits of Morison et al. (1994, J. Atmos. Oceanic Technol. 11, 1151-1164).
    """
    return 0.0264 / flow + 0.0135, 2.7858 / np.sqrt(flow) + 7.1499


def lag_of(time: Array, temperature: Array, flow: float) -> Array:
    """Difference of the water's temperature from that in the cell ``(m,)``, K, by the recursion of Morison et al."""
    anomaly, relaxation = error_and_time(flow)
    lag = np.zeros(len(time))
    for k in range(1, len(time)):
        steps = 2.0 * relaxation / (time[k] - time[k - 1])
        gain = anomaly * steps / (1.0 + steps)
        lag[k] = (2.0 * gain / anomaly - 1.0) * lag[k - 1] + gain * (temperature[k] - temperature[k - 1])
    return lag


def with_corrected_salinity(record: ProfileRecord, flow: float) -> ProfileRecord:
    """Replace the salinity by that of the same conductivity at the temperature in the cell."""
    assert record.temperature is not None
    assert record.practical_salinity is not None
    known = np.isfinite(record.temperature) & np.isfinite(record.practical_salinity)
    temperature, salinity = record.temperature[known], record.practical_salinity[known]
    measured = np.isfinite(record.depth)
    depth = np.interp(record.time[known], record.time[measured], record.depth[measured])
    pressure = gsw.p_from_z(-depth, 45.0)
    conductivity = gsw.C_from_SP(salinity, temperature, pressure)
    cell = temperature - lag_of(record.time[known], temperature, flow)
    corrected = record.practical_salinity.copy()
    corrected[known] = gsw.SP_from_C(conductivity, cell, pressure)
    return replace(record, practical_salinity=corrected)


def effects(record: ProfileRecord, hull: Platform, flow: float) -> tuple[Array, Array, float] | None:
    """Changes of density (kg/m3) and of weight in water (N) on steps, and the net weight (N); None without a CTD."""
    try:
        series = resample(record, STEP, longest_bridged(sampling_intervals(record)))
        found, corrected = (
            seawater_on_steps(series, each)[:, 1] for each in (record, with_corrected_salinity(record, flow))
        )
    except (ProfileError, SeawaterMissingError):
        return None
    change = corrected - found
    volume = hull.mass.total / hull.buoyancy.water_density
    range_ = np.nanmax(record.ballast_volume) - np.nanmin(record.ballast_volume)
    return change, -GRAVITY * volume * change, float(0.5 * range_ * hull.buoyancy.water_density * GRAVITY)


def row(path: Path, flow: float) -> list[str]:
    """Effects over a mission: root mean square and 95th percentile of the sizes."""
    with open_observations(path) as observations:
        hull = gh.load_platform(observations.platform_name)
        records = [
            observations.profile(number) for number in observations.profile_numbers
            if number not in observations.faults
        ]  # fmt: skip
        found = [each for record in records if record.temperature is not None
                 for each in [effects(record, hull, flow)] if each is not None]  # fmt: skip
        speed = [
            float(np.nanmedian(np.abs(np.diff(record.depth) / np.diff(record.time)))) for record in records
        ]  # fmt: skip
    density = np.concatenate([change for change, _, _ in found])
    weight = np.concatenate([change for _, change, _ in found])
    relative = np.concatenate([0.5 * change / net for _, change, net in found])
    velocity = 100.0 * float(np.median(speed)) * relative
    cells = [path.stem, f"{flow:g}", str(len(found))]
    for values, digits in ((density, 4), (weight, 3), (velocity, 3)):
        sizes = np.abs(values[np.isfinite(values)])
        cells.append(f"{np.sqrt(np.mean(sizes**2)):.{digits}f}; {np.quantile(sizes, 0.95):.{digits}f}")
    return cells


def main(arguments: list[str] | None = None) -> None:
    """Bound the effect and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("observations", nargs="+", type=Path)
    given = parser.parse_args(arguments)
    cells = "; ".join(f"{flow:g} m/s: {x:.3f}, {t:.1f} s" for flow in FLOWS for x, t in [error_and_time(flow)])
    heads = ["mission", "flow, m/s", "profiles", "density, kg/m3", "weight in water, N", "depth rate, cm/s"]
    table = markdown(heads, [row(path, flow) for path in given.observations for flow in FLOWS])
    PAGE.write_text(TEMPLATE.read_text("utf-8").format(table=table, cells=cells), "utf-8")


if __name__ == "__main__":
    main()
