"""Drag and lift of a hull from its measured velocity relative to the water, in steady straight glides.

With the velocity measured, each segment of steady flight gives drag and lift directly: along the path the weight in
water balances the drag, ``V^2 (K_D0 + K_D alpha^2) = -W sin(xi)``, and across it the lift, ``V^2 (K_L0 + K_L alpha) =
W cos(xi)``, with the glide angle ``xi = pitch - alpha`` and the angle of attack ``alpha = arctan(w / u)``. Errors of
the neutral volume and of the normal velocity are the same on dive and climb, where drag and lift have opposite signs;
they are estimated too.
"""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.calibration.glides.segment_errors import fits_density
from gliderhpc.estimation.least_squares import jackknife_covariance
from gliderhpc.estimation.preparation import model_controls
from gliderhpc.estimation.steady_segments import SteadySegments
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import HullParameter, hull_parameters, with_values
from gliderhpc.flight.steady_glide import drag_and_lift
from gliderhpc.platform import Platform
from gliderhpc.platform_sections import Uncertainty

Array = NDArray[np.float64]

MIN_SEGMENTS, MIN_PROFILES = 5, 3
"""Minimum numbers of segments, on dives and on climbs, and of profiles."""
MIN_RELATIVE_ERROR = 0.01
"""Minimum relative error of drag and lift: that of the velocity's scale."""
_MIN_SPEED = 0.05
"""Minimum forward velocity of a glide, m/s."""


@dataclass(frozen=True)
class MeasuredPolar:
    """Factors on a hull's drag and lift, and their standard errors.

    Attributes
    ----------
    drag, lift : float
        Factors on ``K_D0`` and ``K_D``, and on ``K_L``.
    drag_error, lift_error : float
        Standard errors of the factors.
    """

    drag: float
    lift: float
    drag_error: float
    lift_error: float


def measured_polar(hull: Platform, segments: SteadySegments, velocity_error: float) -> MeasuredPolar | None:
    """Fit factors on drag and lift to the segments with a measured velocity.

    Parameters
    ----------
    hull : Platform
        Hull whose buoyancy matches the records, such as the result of `gliderhpc.calibration.glides.fit.fit_trim`.
    segments : SteadySegments
        Segments of steady flight.
    velocity_error : float
        Constant error of the measured velocity, m/s.

    Returns
    -------
    MeasuredPolar or None
        None if too few segments or profiles have a velocity (`MIN_SEGMENTS`, `MIN_PROFILES`), or a factor is not
        positive.
    """
    forward, _, normal = segments.velocity.T
    measured = segments.straight & np.isfinite(normal) & (forward > _MIN_SPEED)
    chosen = segments.select(measured)
    heavy = chosen.depth_rate > 0.0
    too_few = min(np.count_nonzero(heavy), np.count_nonzero(~heavy)) < MIN_SEGMENTS
    if too_few or len(np.unique(chosen.profile)) < MIN_PROFILES:
        return None
    matrix, right, profile = _equations(hull, chosen)
    solution, *_ = np.linalg.lstsq(matrix, right)
    drag, lift = float(solution[0]), float(solution[1])
    if min(drag, lift) <= 0.0:
        return None
    scatter = np.sqrt(np.diag(jackknife_covariance(matrix, matrix @ solution - right, profile)))
    relative = velocity_error / float(np.median(chosen.velocity[:, 0]))
    return MeasuredPolar(
        drag,
        lift,
        float(np.sqrt(scatter[0] ** 2 + (2.0 * relative) ** 2 + MIN_RELATIVE_ERROR**2)),
        float(np.sqrt(scatter[1] ** 2 + relative**2 + MIN_RELATIVE_ERROR**2)),
    )


def _equations(hull: Platform, segments: SteadySegments) -> tuple[Array, Array, NDArray[np.int64]]:
    """Balances along and across the path: matrix (2m, 4), right side (2m,), N, and profile of each row (2m,).

    The unknowns are the factors on drag and lift, an additional weight (N), and the factor on the lift times the error
    of the normal velocity (m/s). The rows are means over the dive or the climb of a profile: in a single segment the
    normal velocity, hardly larger than its noise, would make the lift appear too small.
    """
    seawater = segments.seawater if fits_density(hull, segments) else None
    glider = Glider(hull)
    bodies = glider.bodies(model_controls(hull, segments.actuators, seawater))
    weight = glider.net_weight(bodies, segments.depth)
    forward, _, normal = segments.velocity.T
    square, alpha = forward**2 + normal**2, np.arctan2(normal, forward)
    drag, lift = drag_and_lift(hull, alpha)
    lift_offset, lift_slope = hull.viscous.K_L0, hull.viscous.K_L
    along, across = -np.sin(segments.pitch - alpha), np.cos(segments.pitch - alpha)
    zero = np.zeros_like(along)
    drag_rows = np.column_stack([square * drag, zero, -along, zero])
    lift_rows = np.column_stack([zero, square * (lift - lift_offset), -across, -square * lift_slope / forward])
    right = np.column_stack([weight * along, weight * across - square * lift_offset])
    legs, index = np.unique(np.column_stack([segments.profile, segments.depth_rate > 0.0]), axis=0, return_inverse=True)
    means = np.equal.outer(np.arange(len(legs)), index.ravel()) / np.bincount(index.ravel())[:, None]
    matrix = np.vstack([means @ drag_rows, means @ lift_rows])
    return matrix, (means @ right).T.ravel(), np.concatenate([legs[:, 0], legs[:, 0]])


def with_measured_polar(
    platform: Platform,
    hull: Platform,
    segments: SteadySegments,
    velocity_error: float,
    held: Collection[str] = (),
    report: Callable[[str], None] = lambda _: None,
) -> Platform:
    """Return a platform with drag and lift of the measured velocity, and with their errors as plausible deviations.

    Parameters
    ----------
    platform, hull : Platform
        Platform to change, and the same with the buoyancy of the records.
    segments, velocity_error
        As in `measured_polar`.
    held : collection of str
        Keys of the parameters that keep the platform's value.
    report : callable
        Called with a line of text if the velocity is measured.

    Returns
    -------
    Platform
        The platform itself if the velocity is not measured, or in too few segments.

    Notes
    -----
    The platform's value, with its plausible deviation, and the measured one, with its standard error, are averaged with
    the weights of their precisions, in logarithms. The induced drag ``K_D`` stays at the platform's value.
    """
    if not np.isfinite(segments.velocity[:, 0]).any():
        return platform
    polar = measured_polar(hull, segments, velocity_error)
    if polar is None:
        report(
            "drag and lift are not computed from the measured velocity: that needs its forward and normal component in "
            f"{MIN_SEGMENTS} segments of straight flight on dives, as many on climbs, and {MIN_PROFILES} profiles"
        )
        return platform
    report(
        f"measured velocity: drag {polar.drag:.3f} +- {polar.drag_error:.3f} times, lift {polar.lift:.3f} +- "
        f"{polar.lift_error:.3f} times that of the hull with the records' buoyancy"
    )
    parameters = {p.key: p for p in hull_parameters(platform)}
    values, deviations = {}, {}
    for key, value, error in _measured_coefficients(platform, hull, segments, polar):
        if key in held or key not in parameters or not value > 0.0:
            continue
        values[key], deviations[key] = _average_with_platform(parameters[key], platform, value, error)
    if not values:
        return platform
    uncertainty = platform.uncertainty or Uncertainty()
    narrowed = uncertainty.model_copy(update={"deviation": {**uncertainty.deviation, **deviations}})
    return with_values(platform, values).model_copy(update={"uncertainty": narrowed})


def _measured_coefficients(
    platform: Platform, hull: Platform, segments: SteadySegments, polar: MeasuredPolar
) -> tuple[tuple[str, float, float], ...]:
    """Return key, value and relative error of the coefficients of drag and lift by a measured polar."""
    viscous, parameters = hull.viscous, {p.key: p for p in hull_parameters(platform)}
    square = float(np.nanmedian(np.arctan2(segments.velocity[:, 2], segments.velocity[:, 0]) ** 2))
    drag = polar.drag * (viscous.K_D0 + viscous.K_D * square) - platform.viscous.K_D * square
    induced = parameters["viscous.K_D"].slope(platform, 0.0) * square if "viscous.K_D" in parameters else 0.0
    drag_error = math.hypot(polar.drag_error, induced / drag) if drag > 0.0 else math.inf
    return ("viscous.K_D0", drag, drag_error), ("viscous.K_L", polar.lift * viscous.K_L, polar.lift_error)


def _average_with_platform(
    parameter: HullParameter, platform: Platform, value: float, error: float
) -> tuple[float, float]:
    """Average a measured value of a relative error with the platform's; return it with its plausible deviation."""
    prior = parameter.value(platform)
    plausible = parameter.deviation(platform) / (1.0 if parameter.factor else abs(prior))
    precision = 1.0 / plausible**2 + 1.0 / error**2
    mean = prior * math.exp(math.log(value / prior) / error**2 / precision)
    return mean, (1.0 if parameter.factor else mean) / math.sqrt(precision)
