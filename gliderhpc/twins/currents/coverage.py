"""How often the truth lies inside the ellipses that some constants make, and how large these are."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.current_budget import TERMS, CurrentError, fit_budget
from gliderhpc.estimation.current_errors import CurrentErrors, CurrentUncertainty, Drift, current_uncertainty
from gliderhpc.studies.library.current_difference import COVERAGE, sigma_distance
from gliderhpc.twins.runs import Row

Array = NDArray[np.float64]

SPEEDS = (0.0, 0.1, 0.2, 0.3, np.inf)
"""Edges of the bins of the true current's speed, m/s."""

ALL = "all"
COVERS, OVER, UNDER = "covers", "over-covers", "under-covers"
FACTORS = np.geomspace(0.5, 2.0, 141)
"""By which fitted constants may be multiplied so that they cover."""

_ALLOWED = 2.0
"""Binomial standard errors that a share may be off what it should be."""


@dataclass(frozen=True, eq=False)
class Beliefs:
    """Constants of the ellipses, their name, and the twins they are held against."""

    name: str
    settings: CurrentErrors
    rows: Sequence[Row]


def ellipse_of(row: Row, errors: CurrentErrors) -> CurrentUncertainty:
    """Make the ellipse of one twin as a run does: from what is estimated, not from what is true."""
    drift = Drift(
        np.array([row["estimate_north"], row["estimate_east"]]), np.array([row["track_north"], row["track_east"]]),
        row["duration"], row["position_variance"], row["bridged"], np.zeros((2, 2)),
    )  # fmt: skip
    return current_uncertainty(drift, errors)


def error_of(row: Row) -> Array:
    """Estimated minus true current ``(2,)``, m/s."""
    return np.array([row["estimate_north"] - row["current_north"], row["estimate_east"] - row["current_east"]])


def speed_of(row: Row) -> float:
    """Speed of the true current, m/s."""
    return float(np.hypot(row["current_north"], row["current_east"]))


def as_current_error(row: Row) -> CurrentError:
    """Put a twin as the fit takes it; what fixes and bridged displacement explain is known without the constants."""
    known = ellipse_of(row, CurrentErrors())
    return CurrentError(
        (row["current_north"], row["current_east"]), tuple(error_of(row).tolist()),
        (row["track_north"], row["track_east"]), row["duration"], known.fixes**2 + known.actuation**2,
    )  # fmt: skip


def fitted_to_cover(rows: Sequence[Row], names: Sequence[str]) -> CurrentErrors:
    """Fit constants by largest likelihood, and multiply them by what makes their ellipses cover these twins best.

    The likelihood is that of normal errors about zero. Errors that have a mean, or tails, leave its ellipses too narrow
    or too wide; the factor is that whose shares inside are nearest to what they should be, in binomial standard errors.
    """
    fitted = fit_budget([as_current_error(row) for row in rows], names).settings
    ellipses = [ellipse_of(row, fitted) for row in rows]
    known = np.array([ellipse.fixes**2 + ellipse.actuation**2 for ellipse in ellipses])[:, None, None] * np.eye(2)
    explained = np.array([ellipse.covariance for ellipse in ellipses]) - known
    errors = np.array([error_of(row) for row in rows])[..., None]
    excess = []
    for factor in FACTORS:
        squares = (errors * np.linalg.solve(factor**2 * explained + known, errors)).sum(axis=(1, 2))
        excess.append(list(_excess(_shares(np.sqrt(squares)), len(rows)).values()))
    best = float(FACTORS[int(np.argmin(np.square(excess).sum(axis=1)))])
    return CurrentErrors(**{name: best * getattr(fitted, name) for name in TERMS})


def track_offset(rows: Sequence[Row]) -> tuple[float, float]:
    """Mean error of the current along and across the track, m/s; NaN of no twin."""
    if not rows:
        return float("nan"), float("nan")
    turned = [(error_of(row) @ unit, error_of(row) @ _starboard(unit)) for row, unit in _tracks(rows)]
    along, across = np.mean(turned, axis=0).tolist()
    return along, across


def without_offset(rows: Sequence[Row], offset: float) -> list[Row]:
    """Twins with an error along the track (m/s) taken out of the estimate."""
    return [
        row
        | {
            "estimate_north": row["estimate_north"] - offset * unit[0],
            "estimate_east": row["estimate_east"] - offset * unit[1],
        }
        for row, unit in _tracks(rows)
    ]


def coverage_lines(beliefs: Beliefs) -> list[Row]:
    """One line for all twins and one for each bin of speed (`SPEEDS`); bins without twins are left out."""
    distances = _distances(beliefs.rows, beliefs.settings)
    areas = np.array([ellipse_of(row, beliefs.settings).area for row in beliefs.rows])
    errors = np.array([float(np.linalg.norm(error_of(row))) for row in beliefs.rows])
    speeds = np.array([speed_of(row) for row in beliefs.rows])
    bins = [(ALL, np.ones_like(speeds, dtype=np.bool_))]
    bins += [(_bin_name(low, high), (speeds >= low) & (speeds < high)) for low, high in _pairs(SPEEDS)]
    return [
        {"constants": beliefs.name, "speed": name, **_line(distances[inside], areas[inside], errors[inside])}
        for name, inside in bins
        if inside.any()
    ]


def verdict(shares: dict[int, float], twins: int) -> str:
    """Say whether shares inside (by sigma) are what they should be, within two binomial standard errors.

    One ellipse too wide or too narrow is enough to fail.
    """
    excess = _excess(shares, twins).values()
    if max(excess) > _ALLOWED:
        return OVER
    return UNDER if min(excess) < -_ALLOWED else COVERS


def binomial_error(sigma: int, twins: int) -> float:
    """Standard error of a share inside the ellipse of so many sigma, were the ellipse right."""
    return float(np.sqrt(COVERAGE[sigma] * (1.0 - COVERAGE[sigma]) / twins))


def _line(distances: Array, areas: Array, errors: Array) -> dict[str, Any]:
    twins, shares = len(distances), _shares(distances)
    line: dict[str, Any] = {"twins": twins}
    for sigma, share in shares.items():
        line |= {f"inside_{sigma}": share, f"inside_{sigma}_error": binomial_error(sigma, twins)}
    return line | {
        "area": float(areas.mean()),
        "median_distance": float(np.median(distances**2)),
        "error_median": float(np.median(errors)),
        "verdict": verdict(shares, twins),
    }


def _distances(rows: Sequence[Row], settings: CurrentErrors) -> Array:
    return np.array([sigma_distance(error_of(row), ellipse_of(row, settings).covariance) for row in rows])


def _shares(distances: Array) -> dict[int, float]:
    return {sigma: float(np.mean(distances <= sigma)) for sigma in COVERAGE}


def _excess(shares: dict[int, float], twins: int) -> dict[int, float]:
    """Shares over what they should be, in binomial standard errors."""
    return {sigma: (share - COVERAGE[sigma]) / binomial_error(sigma, twins) for sigma, share in shares.items()}


def _tracks(rows: Sequence[Row]) -> list[tuple[Row, Array]]:
    """Twins with the directions ``(2,)`` of their tracks."""
    tracks = [np.array([row["track_north"], row["track_east"]]) for row in rows]
    return [(row, track / np.linalg.norm(track)) for row, track in zip(rows, tracks, strict=True)]


def _starboard(unit: Array) -> Array:
    return np.array([-unit[1], unit[0]])


def along_the_current(rows: Sequence[Row]) -> list[Row]:
    """Error along the current (rms, m/s) by bin of speed, and over the speed: what a relative error has to explain."""
    lines = []
    for low, high in _pairs(SPEEDS):
        ours = [row for row in rows if low <= speed_of(row) < high]
        if ours:
            truths = [np.array([row["current_north"], row["current_east"]]) for row in ours]
            along = np.array([error_of(row) @ u / np.linalg.norm(u) for row, u in zip(ours, truths, strict=True)])
            speed = float(np.sqrt(np.mean([u @ u for u in truths])))
            level = float(np.sqrt(np.mean(along**2)))
            lines.append({"speed": _bin_name(low, high), "twins": len(ours), "along": level, "relative": level / speed})
    return lines


def _pairs(edges: Sequence[float]) -> list[tuple[float, float]]:
    return list(pairwise(edges))


def _bin_name(low: float, high: float) -> str:
    return f"{low:g} to {high:g} m/s" if np.isfinite(high) else f"over {low:g} m/s"
