"""Study ``spectra``: spectra of a disturbance's fast part and the power laws fitted to them (section 5.3).

Each profile has a spectrum of all depths, and the spectra of three depth ranges. Profiles are sorted into groups, from
calm to harsh, by the speed of their depth-averaged current.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.archive.reader import Archive
from gliderhpc.store_schema.columns import BETA, BETA_RESOLVED, PARTS, FitColumns, extent_columns, fit_columns
from gliderhpc.studies.library.tracks import current_columns
from gliderhpc.studies.library.turbulence.series import (
    ChannelSeries,
    GappySeries,
    SpectraSettings,
    channel_of,
    fast_part,
    gappy_series,
    missing_band,
    resolved_band,
    series_step,
)
from gliderhpc.studies.library.turbulence.statistics import (
    Periodograms,
    PowerLaw,
    band_power_law,
    periodograms,
    power_law,
)
from gliderhpc.studies.request import Request
from gliderhpc.studies.study import Preparation, ProfileContext, Row, Study

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NAME = "spectra"

UNKNOWN = "unknown"
"""Group of the profiles without a depth-averaged current."""


# One profile


def study_profile(data: ProfileData, context: ProfileContext) -> Row:
    """Compute spectra of one profile and their exponents, with the profile's group and its current's speed (m/s)."""
    channel = channel_of(data, context.settings.channel, context.platform)
    speed, group = context.inputs[data.number]
    row, spectra = profile_spectra(channel, context.settings)
    return {"group": group, "speed": speed, **row, **spectra}


def profile_spectra(channel: ChannelSeries, settings: SpectraSettings) -> tuple[dict[str, Any], dict[str, Array]]:
    """Compute the spectra of one profile and their exponents.

    Returns
    -------
    row : dict
        Row of the group's table; if the record does not resolve the band at all, the reason and no exponents.
    spectra : dict of str to (m,) array
        Frequencies (Hz) and densities; empty for such a record.
    """
    part = fast_part(channel, settings, actuated=False)
    deep_enough = channel.depth >= settings.shallowest
    counted = part.series.counted & deep_enough
    row: dict[str, Any] = {"nyquist": channel.nyquist, "counted": float(counted.mean())}
    if part.message:
        return {**row, "message": part.message}, {}
    rng = np.random.default_rng(settings.seed)
    chosen_by_part = (counted, *thirds(channel.depth, counted))
    spectra_by_part = [_periodograms(part.series, chosen, settings) for chosen in chosen_by_part]
    for name, chosen, spectra in zip(PARTS, chosen_by_part, spectra_by_part, strict=True):
        row |= _extent_row(name, channel.depth[chosen], len(spectra.density))
        row |= _exponents_row(spectra, channel, settings, rng, name)
    row["rms"] = part.series.rms
    with_actuated = fast_part(channel, settings, actuated=True).series
    spectra_all = _periodograms(with_actuated, with_actuated.counted & deep_enough, settings)
    row |= _exponents_row(spectra_all, channel, settings, rng, None)
    all_depths = spectra_by_part[0]
    return row, {"frequency_hz": all_depths.frequency, "density": all_depths.mean, "density_all": spectra_all.mean}


def thirds(depth: Array, counted: Mask) -> tuple[Mask, Mask, Mask]:
    """Masks ``(n,)`` of the shallow, middle and deep samples among those used, a third of the time each."""
    if not counted.any():
        return counted, counted, counted
    low, high = np.percentile(depth[counted], [100.0 / 3.0, 200.0 / 3.0])
    return counted & (depth <= low), counted & (depth > low) & (depth <= high), counted & (depth > high)


def _periodograms(series: GappySeries, chosen: Mask, settings: SpectraSettings) -> Periodograms:
    return periodograms(gappy_series(series.values, chosen, series.step), settings.segment)


def _extent_row(part: str, depth: Array, segments: int) -> dict[str, Any]:
    columns = extent_columns(part)
    if not depth.size:
        return {columns.segments: segments}
    return {
        columns.shallowest: float(depth.min()),
        columns.deepest: float(depth.max()),
        columns.segments: segments,
    }


def _exponents_row(
    spectra: Periodograms,
    channel: ChannelSeries,
    settings: SpectraSettings,
    rng: np.random.Generator,
    part: str | None,
) -> dict[str, Any]:
    """Exponents over the band and over its resolved part, of the spectrum of a depth range, or of all samples if None.

    All samples include those taken while actuators move.
    """
    on_band = band_power_law(spectra, channel.step, settings, settings.draws, rng)
    resolved = resolved_band(settings.band, channel.nyquist)
    on_resolved = power_law(spectra, resolved, settings.draws, rng)
    return _fit_row(fit_columns(BETA, part), on_band) | _fit_row(fit_columns(BETA_RESOLVED, part), on_resolved)


def _fit_row(columns: FitColumns, law: PowerLaw) -> dict[str, Any]:
    return dict(zip(columns, (law.exponent, law.low, law.high, law.r2), strict=True))


# Groups of profiles


def current_speeds(archive: Archive, numbers: Sequence[int], estimate: str) -> dict[int, float]:
    """Speed of each profile's depth-averaged current (m/s); NaN if there is none."""
    columns = current_columns(estimate)
    table = archive.to_dataset()[[columns.north, columns.east]].sel(profile=list(numbers)).load()
    values = np.hypot(table[columns.north].values, table[columns.east].values)
    return dict(zip(numbers, values.tolist(), strict=True))


def groups_by_speed(speed: dict[int, float], count: int) -> dict[int, str]:
    """Sort profiles into `count` groups of similar size, or fewer groups if fewer profiles have a current."""
    known = sorted((number for number in speed if np.isfinite(speed[number])), key=lambda number: speed[number])
    groups = dict.fromkeys(speed, UNKNOWN)
    for name, part in zip(_group_names(min(count, len(known))), np.array_split(known, max(1, count)), strict=False):
        groups |= {int(number): name for number in part}
    return groups


def _group_names(count: int) -> list[str]:
    """Names of `count` groups, from calm to harsh."""
    if count < 2:
        return ["all"][:count]
    between = ["middle"] if count == 3 else [f"middle {i + 1}" for i in range(count - 2)]
    return ["calm", *between, "harsh"]


# The study


def prepare(request: Request, archive: Archive, numbers: tuple[int, ...], settings: SpectraSettings) -> Preparation:
    """Sort the profiles into groups, and determine the number of frequencies."""
    speed = current_speeds(archive, numbers, request.estimate)
    groups = groups_by_speed(speed, settings.groups)
    frequencies = max(2, round(settings.segment / series_step(archive, request.estimate))) // 2 + 1
    return Preparation(
        inputs={number: (speed[number], groups[number]) for number in numbers}, sizes={"frequency": frequencies}
    )


STUDY = Study(
    NAME,
    "spectra of a disturbance's fast part and their exponents",
    profile=study_profile,
    settings=SpectraSettings,
    missing=missing_band,
    prepare=prepare,
)
