"""Next surfacing: predicted place and time of the end of a dive like the last ones, in the predicted current."""

from collections.abc import Container, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.reader import Archive
from gliderhpc.distributions import chi_square_quantile
from gliderhpc.estimation.currents import local_displacement
from gliderhpc.observations.fixes import moved
from gliderhpc.observations.records import Fix
from gliderhpc.observations.times import SECOND
from gliderhpc.studies.library.scores import covariance_matrix
from gliderhpc.surfacing.dive_plan import DivePlan
from gliderhpc.surfacing.next_displacement import expected_displacement, planned_scatter
from gliderhpc.surfacing.nowcast import CurrentObservation, Nowcast, nowcasts
from gliderhpc.vocabulary import TIDAL_PERIODS

Array = NDArray[np.float64]

MAX_DIVES = 60
"""Maximum number of past dives used by the nowcast."""

_COMPARED, _PRIOR_DRIFTS = 20, 3
"""Maximum number of past predictions and of drifts at the surface that are used, and number of prior drifts assumed in
addition."""

PROBABILITY = 0.68
"""Probability of the ellipses of positions and currents."""

_PRIOR_PREDICTIONS, _SCALES = 10, (0.1, 10.0)
"""Number of past predictions whose evidence has half the weight, and limits of the factor on a covariance."""

_OFFSET = 0.2
"""Prior standard deviation of the mean difference between the drift at the surface and the current below, north and
east each, m/s: wind, waves and the flow near the surface."""

LONGEST_STAY = 3600.0
"""Longest plausible time at the surface, s; a longer time between two dives means that records are missing."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted end of the next dive, which lasts as long as the last one or as planned.

    Attributes
    ----------
    time : numpy.datetime64
        Time of the surfacing.
    latitude, longitude : float
        Position of the surfacing, degrees.
    covariance : (2, 2) array
        Covariance of the position, north and east, m2.
    current : (2,) array
        Mean current until then, north and east, m/s.
    current_covariance : (2, 2) array
        Covariance of the error of this current, including that of the last dive's current, m2/s2.
    dives : int
        Number of dives whose currents were used.
    deviation, correlation_time : float
        Standard deviation (m/s) and correlation time (s) of the most probable process for the variable, non-tidal part
        of the current.
    """

    time: np.datetime64
    latitude: float
    longitude: float
    covariance: Array
    current: Array
    current_covariance: Array
    dives: int
    deviation: float
    correlation_time: float


def predict_surfacing(archive: Archive, number: int, plan: DivePlan | None = None) -> Prediction | None:
    """Predict the surfacing after the next dive from the dives up to a given one.

    Parameters
    ----------
    archive : Archive
        The archive, opened.
    number : int
        Number of the last dive.
    plan : DivePlan, optional
        Plan of the next dive.

    Returns
    -------
    Prediction or None
        Prediction; None if the last dive has no smoothed current, for lack of a fix before or after it.
    """
    dives = dives_until(archive, number)
    if not dives.sizes["profile"] or int(dives["profile"][-1]) != number:
        return None
    errors = archive.attrs["settings"]["current"]
    return predict_from(dives, float(errors["fix_error"]), float(errors["surface_shear"]), plan=plan)


def predict_from(
    dives: xr.Dataset,
    fix_error: float,
    surface_shear: float,
    tides: Sequence[str] = tuple(TIDAL_PERIODS),
    plan: DivePlan | None = None,
) -> Prediction:
    """Predict the surfacing after the next dive from the table of the dives so far.

    Parameters
    ----------
    dives : xarray.Dataset
        One or more rows of the archive's table in order of time, with ``displacement_north`` and
        ``displacement_east`` of the group ``smoothed``, and ``stay``, the time (s) from the first fix after the dive
        before to the last one before the dive; NaN where unknown.
    fix_error : float
        Error of a fix, north and east each, m.
    surface_shear : float
        Usual difference between the drift at the surface and the current below, m/s.
    tides : sequence of str
        Tidal lines of the current, from `gliderhpc.vocabulary.TIDAL_PERIODS`; empty for a current without tide.
    plan : DivePlan, optional
        Plan of the next dive, by default a dive like the last one.

    Notes
    -----
    The position is the sum of the last fix, the displacement expected of the next dive, and the filter's integral of
    the current. The displacement and its covariance follow from the pattern of the courses so far, such as a dive like
    the last one or several courses in turn, adjusted against the last change of the current to the extent that the
    glider did so before (`expected_displacement`). An error common to all dives, such as a wrong drag, changes
    displacement and current in opposite directions and leaves the position unchanged. The errors of the filter's
    observations are therefore only those of the fixes and of the time at the surface; those of the hull are added to
    the predicted current. At the surface the glider drifts with the current and a further, constant velocity, with the
    scatter that the drifts so far have (`surface_offset`). The covariance of the position is scaled by the
    misses that the same prediction had after each of the dives before (`ellipse_scale`). A planned duration or speed
    changes the length of the expected displacement. With a planned heading, the displacement is by default as long as
    the last one; its scatter is that of past lengths, and across the heading a tenth of the length
    (`planned_scatter`), unscaled.
    """
    surface = surface_offset(dives, surface_shear)
    flown = (_vectors(dives, "displacement_{}"), _vectors(dives, "dac_{}_smoothed"), dives["duration"].values)
    displacements, count = flown[0], dives.sizes["profile"]
    states = _nowcasts_after(dives, fix_error, surface, tides, range(count - 1 - _COMPARED, count))
    latest, last = states.pop(count - 1), fix_after(dives, count - 1)
    past = []
    for dive, state in states.items():
        if is_followed(dives, dive):
            then = expected_displacement(*(values[: dive + 1] for values in flown))
            past.append(_predict_cycle(dives, dive, state, surface, then, fix_error=fix_error))
    scale = ellipse_scale([_squared_distance(dives, cycle) for cycle in past])
    (through, spread), duration = expected_displacement(*flown), None
    if plan is not None:
        ordered = through if plan.heading is None else displacements[-1]
        through, duration = plan.displacement(ordered, float(dives["duration"][-1])), plan.duration
        if plan.heading is not None:
            spread, scale = planned_scatter(displacements, through), 1.0
    coming = _predict_cycle(
        dives, count - 1, latest, surface, (through, spread), fix_error=fix_error, duration=duration
    )
    latitude, longitude = moved((last.latitude, last.longitude), coming.displacement)
    return Prediction(
        time=last.time + np.timedelta64(round(coming.elapsed), "s"),
        latitude=latitude,
        longitude=longitude,
        covariance=scale * coming.covariance,
        current=coming.drift / coming.elapsed,
        current_covariance=coming.drift_covariance / coming.elapsed**2 + _covariance(dives.isel(profile=-1)),
        dives=count,
        deviation=coming.state.deviation,
        correlation_time=coming.state.correlation_time,
    )


@dataclass(frozen=True, eq=False)
class _Cycle:
    """Predicted displacement from the surfacing after a dive to the next: at the surface, and in the next dive.

    Attributes
    ----------
    dive : int
        Position of the dive in the table.
    state : Nowcast
        Nowcast after the dive.
    elapsed : float
        Time from the first fix after the dive to the next surfacing, s.
    displacement, covariance : (2,), (2, 2) arrays
        Displacement over ground, north and east, and its covariance, m and m2.
    drift, drift_covariance : (2,), (2, 2) arrays
        The water's part of this displacement, and its covariance.
    """

    dive: int
    state: Nowcast
    elapsed: float
    displacement: Array
    covariance: Array
    drift: Array
    drift_covariance: Array


def _predict_cycle(
    dives: xr.Dataset,
    dive: int,
    state: Nowcast,
    surface: tuple[Array, float],
    through: tuple[Array, Array],
    *,
    fix_error: float,
    duration: float | None = None,
) -> _Cycle:
    """Predict the cycle after a dive, given surface drifts (offset, scatter) and displacement (value, covariance).

    The next dive lasts as long as that dive, or the `duration` given, s.
    """
    (offset, scatter), (displacement, spread) = surface, through
    at_surface, below = _cycle(dives, dive)
    below = below if duration is None else duration
    begin = max(float(_seconds(dives, "exit_time")[dive]), state.time)
    drift, covariance = state.drift(begin, begin + at_surface + below)
    shear = (scatter * at_surface) ** 2 + 2.0 * fix_error**2
    return _Cycle(
        dive=dive,
        state=state,
        elapsed=at_surface + below,
        displacement=displacement + offset * at_surface + drift,
        covariance=covariance + spread + shear * np.eye(2),
        drift=drift,
        drift_covariance=covariance,
    )


def is_followed(dives: xr.Dataset, dive: int) -> bool:
    """Return whether the next dive in the table began before the longest stay at the surface had passed."""
    stay = (dives["start_time"].values[dive + 1] - dives["exit_time"].values[dive]) / SECOND
    return bool(stay <= LONGEST_STAY)


def fix_after(dives: xr.Dataset, dive: int) -> Fix:
    """Return the first fix after a dive in the table."""
    time, latitude, longitude = (_value(dives, f"exit_{name}", dive) for name in ("time", "latitude", "longitude"))
    return Fix(time.astype("datetime64[ns]"), float(latitude), float(longitude))


def _squared_distance(dives: xr.Dataset, predicted: _Cycle) -> float:
    """Return the squared distance of the next surfacing from the predicted one, relative to its ellipse."""
    here, there = (fix_after(dives, dive) for dive in (predicted.dive, predicted.dive + 1))
    miss = np.array(local_displacement(here, there)) - predicted.displacement
    return float(miss @ np.linalg.solve(predicted.covariance, miss))


def ellipse_scale(distances: Sequence[float]) -> float:
    """Return the factor on the covariance with which its 68 % ellipse would have contained 68 % of past surfacings.

    Parameters
    ----------
    distances : sequence of float
        Squared distances of past surfacings from their predictions, relative to the predicted ellipses.

    Notes
    -----
    The factor is the ratio of the distances' quantile to that of a normal distribution, to the power ``n / (n + 10)``
    for n predictions; without any it is one. A few changes of course, for example, add to the mean square of the
    displacements' differences, and make the ellipse too wide for all other dives.
    """
    count = len(distances)
    if not count:
        return 1.0
    ratio = float(np.quantile(distances, PROBABILITY)) / chi_square_quantile(PROBABILITY, 2)
    return float(np.clip(ratio, *_SCALES) ** (count / (count + _PRIOR_PREDICTIONS)))


def dives_until(archive: Archive, number: int, most: int | None = MAX_DIVES) -> xr.Dataset:
    """Return the rows of the latest dives, up to a given one, that have a smoothed current; `most` of them."""
    table = archive.to_dataset().load()
    smoothed = archive["smoothed"].to_dataset()
    names = ("displacement_north", "displacement_east")
    table = table.assign({name: smoothed[name].load() for name in names})
    table = table.sortby("start_time")
    # Also without a current, the dive before is not a time at the surface.
    table["stay"] = (table["entry_time"] - table["exit_time"].shift(profile=1)) / SECOND
    known = np.isfinite(table["dac_north_smoothed"].values) & np.isfinite(table["displacement_north"].values)
    known &= table["start_time"].values <= table["start_time"].sel(profile=number).values
    rows = np.flatnonzero(known)
    return table.isel(profile=rows if most is None else rows[-most:])


def _value(dives: xr.Dataset, name: str, dive: int) -> Any:
    """Return one value of the table; a row of its seventy columns would take a hundred times as long."""
    return dives.variables[name].values[dive]


def _seconds(dives: xr.Dataset, name: str) -> Array:
    elapsed: Array = (dives[name].values - dives["start_time"].values[0]) / SECOND
    return elapsed


def surface_offset(dives: xr.Dataset, surface_shear: float) -> tuple[Array, float]:
    """Return the mean difference (2,) of the drift at the surface from the current of the dive before, and its scatter.

    Notes
    -----
    The mean has the prior ``N(0, 0.2^2)``, the square of the scatter the prior value ``surface_shear^2`` with the
    weight of three drifts. Wind and the flow near the surface persist from dive to dive, which an error that is
    independent between dives does not describe.
    """
    time = dives["exit_surface_time"].values
    drift, current = (_vectors(dives, columns) for columns in ("exit_surface_{}", "dac_{}_smoothed"))
    known = np.isfinite(drift).all(axis=1) & (time > 0.0)
    differences = (drift[known] / time[known, None] - current[known])[-_COMPARED:]
    count = len(differences)
    if not count:
        return np.zeros(2), surface_shear
    mean = differences.mean(axis=0)
    squares = 0.5 * float(np.sum((differences - mean) ** 2)) + _PRIOR_DRIFTS * surface_shear**2
    scatter = float(np.sqrt(squares / (count - 1 + _PRIOR_DRIFTS)))
    return mean * _OFFSET**2 / (_OFFSET**2 + scatter**2 / count), scatter


def _nowcasts_after(
    dives: xr.Dataset,
    fix_error: float,
    surface: tuple[Array, float],
    tides: Sequence[str],
    wanted: Container[int],
) -> dict[int, Nowcast]:
    """Return the nowcast after each of the wanted dives, by the dive's position, in order."""
    observed = [
        (dive, observation)
        for dive, observed_by_dive in enumerate(_observations(dives, fix_error, *surface))
        for observation in observed_by_dive
    ]
    states = nowcasts([observation for _, observation in observed], tides)
    # The last observation of a dive replaces those before.
    return {dive: state for (dive, _), state in zip(observed, states, strict=True) if dive in wanted}


def _observations(dives: xr.Dataset, fix_error: float, offset: Array, scatter: float) -> list[list[CurrentObservation]]:
    """Return for each dive, in order, its current, and the drift at the surface after it less the offset."""
    starts, exits = _seconds(dives, "start_time"), _seconds(dives, "exit_time")
    observations: list[list[CurrentObservation]] = []
    for dive, begin in enumerate(starts):
        duration = float(_value(dives, "duration", dive))
        end = begin + duration
        surface = max(_seconds_between_fixes(dives, dive) - duration, 0.0)
        variance = 2.0 * fix_error**2 + (scatter * surface) ** 2
        velocity = np.array([float(_value(dives, f"dac_{side}_smoothed", dive)) for side in ("north", "east")])
        observations.append([CurrentObservation(begin, end, velocity, variance / duration**2)])
        time = float(_value(dives, "exit_surface_time", dive))
        later = starts[dive + 1] if dive + 1 < len(starts) else np.inf
        if time > 0.0 and end <= exits[dive] <= later:
            drifted = np.array([float(_value(dives, f"exit_surface_{side}", dive)) for side in ("north", "east")])
            drift = drifted / time - offset
            variance = scatter**2 + 2.0 * (fix_error / time) ** 2
            observations[-1].append(CurrentObservation(exits[dive], exits[dive], drift, variance))
    return observations


def _cycle(dives: xr.Dataset, dive: int) -> tuple[float, float]:
    """Return the times (s) at the surface and below for a cycle like that of a dive."""
    below, stay = float(_value(dives, "duration", dive)), float(_value(dives, "stay", dive))
    surface = _seconds_between_fixes(dives, dive) - below
    surface += stay if 0.0 <= stay <= LONGEST_STAY else 0.0
    return max(surface, 0.0), below


def _seconds_between_fixes(dives: xr.Dataset, dive: int) -> float:
    """Return the time from the last fix before a dive to the first one after it, s."""
    return float((_value(dives, "exit_time", dive) - _value(dives, "entry_time", dive)) / SECOND)


def _vectors(dives: xr.Dataset, columns: str) -> Array:
    """Return the columns ``(n, 2)`` of a quantity to the north and to the east."""
    return np.column_stack([dives[columns.format(side)].values for side in ("north", "east")])


def _covariance(row: xr.Dataset) -> Array:
    names = ("dac_north_smoothed_std", "dac_east_smoothed_std", "dac_smoothed_covariance")
    return covariance_matrix(*(row[name] for name in names))
