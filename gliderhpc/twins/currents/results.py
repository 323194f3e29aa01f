"""Results of ``twin currents``: coverage of the ellipses by several sets of constants, and transfer functions."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import InputError
from gliderhpc.estimation.current_errors import (
    PUBLISHED_TERMS,
    TERMS,
    Budget,
    CurrentError,
    CurrentErrors,
    CurrentUncertainty,
    Drift,
    current_uncertainty,
    fit_budget,
)
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.studies.library.passband import Passband, passband
from gliderhpc.studies.library.retrieval import DepthResolvedSettings
from gliderhpc.studies.library.scores import COVERAGE, sigma_distance
from gliderhpc.twins.cases import PRESETS
from gliderhpc.twins.currents.resolved import resolved_band, summary_lines, transfer_lines
from gliderhpc.twins.currents.runs import AVERAGED, GUSTS, LAGLESS, RESOLVED, STILL, WORLDS, CurrentsSize
from gliderhpc.twins.scoring import Row
from gliderhpc.twins.study import TwinPlan, select

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SPEEDS = (0.0, 0.1, 0.2, 0.3, np.inf)
"""Edges of the bins of the true current's speed, m/s."""

ALL = "all"
COVERS, OVER, UNDER = "covers", "over-covers", "under-covers"
FACTORS = np.geomspace(0.5, 2.0, 141)
"""Trial factors of fitted constants, of which the one with the best coverage is chosen."""

PUBLISHED, RECOVERABILITY = "published", "recoverability"
FITTED_FORM, FITTED, CENTRED = "fitted, published form", "fitted", "fitted, mean error removed"
"""Names of the sets of constants: that of section 5.5, that of a given budget, and those of this study: with three
terms, with four terms, and with four terms fitted to errors without their mean along the track."""

RESOLVING = PRESETS[1]
"""Preset that determines the limits of the transfer function; it starts the lateral channels from zero."""

_MAX_EXCESS = 2.0
"""Maximum deviation of a share from its nominal value, in binomial standard errors."""


@dataclass(frozen=True, eq=False)
class EllipseModel:
    """Constants of the ellipses, their name, and the twins that test them."""

    name: str
    settings: CurrentErrors
    rows: Sequence[Row]


def ellipse_of(row: Row, errors: CurrentErrors) -> CurrentUncertainty:
    """Compute the ellipse of one twin from the estimates alone, as in a run."""
    drift = Drift(
        np.array([row["estimate_north"], row["estimate_east"]]),
        np.array([row["track_north"], row["track_east"]]),
        row["duration"],
        row["position_variance"],
        row["bridged"],
        np.zeros((2, 2)),
    )
    return current_uncertainty(drift, errors)


def error_of(row: Row) -> Array:
    """Estimated minus true current ``(2,)``, m/s."""
    return np.array([row["estimate_north"] - row["current_north"], row["estimate_east"] - row["current_east"]])


def speed_of(row: Row) -> float:
    """Speed of the true current, m/s."""
    return float(np.hypot(row["current_north"], row["current_east"]))


def as_current_error(row: Row) -> CurrentError:
    """Convert a twin for the fit; the variance of fixes and bridged displacement is independent of the constants."""
    known = ellipse_of(row, CurrentErrors())
    return CurrentError(
        (row["current_north"], row["current_east"]),
        tuple(error_of(row).tolist()),
        (row["track_north"], row["track_east"]),
        row["duration"],
        known.fixes**2 + known.actuation**2,
    )


def fitted_to_cover(rows: Sequence[Row], names: Sequence[str]) -> CurrentErrors:
    """Fit constants by maximum likelihood, and multiply them by the factor whose ellipses cover these twins best.

    The likelihood assumes normal errors about zero. If errors have a mean or heavy tails, its ellipses are too narrow
    or too wide. With the chosen factor, the shares inside are nearest to the nominal ones, in binomial standard errors.
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
    """Mean error of the current along and across the track, m/s; NaN without twins."""
    if not rows:
        return float("nan"), float("nan")
    turned = [(error_of(row) @ unit, error_of(row) @ _starboard(unit)) for row, unit in _tracks(rows)]
    along, across = np.mean(turned, axis=0).tolist()
    return along, across


def without_offset(rows: Sequence[Row], offset: float) -> list[Row]:
    """Return twins with an error along the track (m/s) removed from the estimate."""
    return [
        row
        | {
            "estimate_north": row["estimate_north"] - offset * unit[0],
            "estimate_east": row["estimate_east"] - offset * unit[1],
        }
        for row, unit in _tracks(rows)
    ]


def along_the_current(rows: Sequence[Row]) -> list[Row]:
    """Error along the current by bin of speed (rms, m/s), and its ratio to the speed, which a relative error models."""
    lines = []
    for name, inside in _speed_bins(np.array([speed_of(row) for row in rows])):
        ours = list(compress(rows, inside))
        truths = [np.array([row["current_north"], row["current_east"]]) for row in ours]
        along = np.array([error_of(row) @ u / np.linalg.norm(u) for row, u in zip(ours, truths, strict=True)])
        speed = float(np.sqrt(np.mean([u @ u for u in truths])))
        level = float(np.sqrt(np.mean(along**2)))
        lines.append({"speed": name, "twins": len(ours), "along": level, "relative": level / speed})
    return lines


def coverage_lines(model: EllipseModel) -> list[Row]:
    """Coverage of a set of constants: one line for all twins, and one per bin of speed (`SPEEDS`) with twins."""
    distances = _distances(model.rows, model.settings)
    areas = np.array([ellipse_of(row, model.settings).area for row in model.rows])
    errors = np.array([float(np.linalg.norm(error_of(row))) for row in model.rows])
    speeds = np.array([speed_of(row) for row in model.rows])
    bins = [(ALL, np.ones_like(speeds, dtype=np.bool_)), *_speed_bins(speeds)]
    return [
        {"constants": model.name, "speed": name, **_line(distances[inside], areas[inside], errors[inside])}
        for name, inside in bins
    ]


def _speed_bins(speeds: Array) -> list[tuple[str, Mask]]:
    """Names and members of the bins of speed (`SPEEDS`) that are not empty."""
    bins = [
        (f"{low:g} to {high:g} m/s" if np.isfinite(high) else f"over {low:g} m/s", (speeds >= low) & (speeds < high))
        for low, high in pairwise(SPEEDS)
    ]
    return [(name, inside) for name, inside in bins if inside.any()]


def verdict(shares: dict[int, float], twins: int) -> str:
    """Compare shares inside (by sigma) with the nominal ones, within two binomial standard errors.

    The constants fail if a single ellipse is too wide or too narrow.
    """
    excess = _excess(shares, twins).values()
    if max(excess) > _MAX_EXCESS:
        return OVER
    return UNDER if min(excess) < -_MAX_EXCESS else COVERS


def binomial_error(sigma: int, twins: int) -> float:
    """Standard error of the share inside a correct ellipse of `sigma`."""
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
    """Shares minus the nominal ones, in binomial standard errors."""
    return {sigma: (share - COVERAGE[sigma]) / binomial_error(sigma, twins) for sigma, share in shares.items()}


def _tracks(rows: Sequence[Row]) -> list[tuple[Row, Array]]:
    """Return the twins with the directions ``(2,)`` of their tracks."""
    tracks = [np.array([row["track_north"], row["track_east"]]) for row in rows]
    return [(row, track / np.linalg.norm(track)) for row, track in zip(rows, tracks, strict=True)]


def _starboard(unit: Array) -> Array:
    return np.array([-unit[1], unit[0]])


@dataclass(frozen=True, eq=False)
class CurrentsResults:
    """Results of the study.

    Attributes
    ----------
    averaged, resolved : list of dict
        One row per twin.
    refused : list of str
        Reasons of the twins without a row.
    coverage : list of dict
        One line per set of constants and bin of speed.
    constants : dict of str to CurrentErrors
        Constants by the name of the set.
    along : list of dict
        Error along the current by bin of speed.
    bias : (float, float)
        Mean error along and across the track, m/s.
    lagless_bias : (float, float)
        Mean error along and across the track of the twins whose actuators do not lag, m/s.
    motion_bias : float
        Mean error of the modelled motion through the water along the track, m/s.
    summary, transfer : list of dict
        Medians over the twins; gain, phase and coherence by vertical scale.
    band : Passband
        Limits by formula, at the twins' median vertical speed.
    seen : dict of str to (float, float)
        Vertical scales resolved by each preset in the strongest broadband water, m.
    noise : dict of str to float
        Lateral current due to noise alone with each preset, rms, m/s.
    """

    averaged: list[Row]
    resolved: list[Row]
    refused: list[str]
    coverage: list[Row]
    constants: dict[str, CurrentErrors]
    along: list[Row]
    bias: tuple[float, float]
    lagless_bias: tuple[float, float]
    motion_bias: float
    summary: list[Row]
    transfer: list[Row]
    band: Passband
    seen: dict[str, tuple[float, float]]
    noise: dict[str, float]


def currents_results(plan: TwinPlan[CurrentsSize], rows: Sequence[Row], budget: Budget | None) -> CurrentsResults:
    """Compute coverage and transfer functions.

    The constants of this study are fitted to the twins of odd seeds and tested on those of even seeds. The published
    constants and those of the given budget are tested on all twins.

    Raises
    ------
    InputError
        So many twins were refused that constants cannot be fitted or tested.
    """
    known = [row for row in rows if "refused" not in row]
    averaged, resolved = (select(known, kind=kind) for kind in (AVERAGED, RESOLVED))
    models = _uncertainty_models(averaged, budget)
    if not resolved:
        raise InputError("every twin in shear and gusts was refused, so there is no transfer function")
    transfer, summary = transfer_lines(resolved), summary_lines(resolved)
    seen = {preset: resolved_band(strongest(transfer, preset)) for preset in PRESETS}
    return CurrentsResults(
        averaged=averaged,
        resolved=resolved,
        refused=[row["refused"] for row in rows if "refused" in row],
        coverage=[line for model in models for line in coverage_lines(model)],
        constants={model.name: model.settings for model in models},
        along=along_the_current(averaged),
        bias=track_offset(averaged),
        lagless_bias=track_offset(select(known, kind=LAGLESS)),
        motion_bias=float(np.mean([row["velocity_along"] for row in averaged])),
        summary=summary,
        transfer=transfer,
        band=_band(plan, resolved),
        seen=seen,
        noise={line["preset"]: line["lateral_rms"] for line in select(summary, world=STILL)},
    )


def strongest(transfer: Sequence[Row], preset: str) -> list[Row]:
    """Lines of a preset in the strongest broadband water."""
    factor = WORLDS[GUSTS][0][-1]
    return select(transfer, preset=preset, world=GUSTS, factor=factor)


def _uncertainty_models(averaged: Sequence[Row], budget: Budget | None) -> list[EllipseModel]:
    ours, others = ([row for row in averaged if row["seed"] % 2 == odd] for odd in (1, 0))
    if not (ours and others):
        raise InputError("no twin is left to fit to, or to test the ellipses on; give more `seeds`")
    offset, _ = track_offset(ours)
    centred, others_centred = without_offset(ours, offset), without_offset(others, offset)
    of_budget = [] if budget is None else [EllipseModel(RECOVERABILITY, budget.current, averaged)]
    return [
        EllipseModel(PUBLISHED, CurrentErrors(), averaged),
        *of_budget,
        EllipseModel(FITTED_FORM, fitted_to_cover(ours, PUBLISHED_TERMS), others),
        EllipseModel(FITTED, fitted_to_cover(ours, TERMS), others),
        EllipseModel(CENTRED, fitted_to_cover(centred, TERMS), others_centred),
    ]


def _band(plan: TwinPlan[CurrentsSize], resolved: Sequence[Row]) -> Passband:
    (platform,) = plan.platforms
    return passband(
        platform,
        speed=float(np.median([row["speed"] for row in resolved])),
        vertical_speed=float(np.median([row["depth_rate"] for row in resolved])),
        step=EstimationSettings().step,
        settings=DepthResolvedSettings(),
    )
