"""Errors of a hull's balance over steady segments as a function of its parameters, with density or depth slope."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import groupby
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import InputError
from gliderhpc.estimation.preparation import is_unexpected_density, model_controls, surface_density
from gliderhpc.estimation.steady_balance import SteadyBalance, steady_balances
from gliderhpc.estimation.steady_segments import SteadySegments
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import (
    ATTITUDE_PARAMETERS,
    PARAMETERS,
    PARAMETERS_BY_DENSITY,
    ROLL_OFFSET,
    TREND,
    UNFITTED_MOTION,
    HullParameter,
    compressible,
    with_values,
)
from gliderhpc.flight.steady_glide import best_angle_of_attack, least_glide_angle
from gliderhpc.platform import CUBIC_CENTIMETRE, Platform, Sensors
from gliderhpc.wording import counted, most_frequent_reason

Array = NDArray[np.float64]

DIFFERENCE = 1e-4
"""Step of the finite differences, in plausible deviations."""

FLATTEST_MARGIN = 1.25
"""Minimum ratio of the segments' flattest pitch to the flattest pitch at which the hull can glide."""

MIN_PROFILES = 3
"""Minimum number of profiles for the uncertainty of an estimate."""

LATERAL = ("viscous.K_beta", "viscous.K_MR", "viscous.K_MY", "viscous.K_r")
"""Coefficients that decide, with the speed, whether a hull is stable in yaw and roll."""

TURNING = (*LATERAL, "viscous.K_delta", "position.hull.1", "battery_eccentricity", ROLL_OFFSET.key)
"""Parameters that are fitted to roll and rate of turn where these are fitted apart from depth rate and pitch."""

_ROLL = 2
"""Index of roll among the four quantities; it and the rate of turn, which follows, are those of turns."""

_DAY = np.timedelta64(1, "D")
_ROUNDED = (1, 2)


def keys_of(names: Sequence[str], parameters: Sequence[HullParameter]) -> list[str]:
    """Return the keys of parameters given by key or by the part after its section, such as ``K_L``.

    Raises
    ------
    InputError
        No parameter has the name.
    """
    keys = []
    for name in names:
        matches = [p.key for p in parameters if name in (p.key, p.key.partition(".")[2])]
        if not matches:
            raise InputError(
                f"`calibration.hold`: no parameter {name}; the parameters are {', '.join(p.key for p in parameters)}"
            )
        keys += matches
    return keys


class SegmentErrors:
    """Errors of the balance over n segments; the parameters (p,) in plausible deviations from the platform's values.

    Attributes
    ----------
    platform, parameters, segments : Platform, tuple of HullParameter, SteadySegments
        Hull, parameters and segments.
    reference : numpy.datetime64
        Time at which a trend of the neutral volume is zero; by default the middle of the segments' time.
    counted : (n, 4) of bool
        Mask of the errors used: depth rate and pitch in straight flight only, roll and rate of turn always.
    kind, profile, leg : (m,) int arrays
        Index of the quantity, number of the profile, and number of the dive or climb, for every error used.
    separate_turns : bool
        Whether parameters `TURNING` are fitted to roll and rate of turn alone, and all others to depth rate and pitch.
    """

    def __init__(
        self,
        platform: Platform,
        parameters: Sequence[HullParameter],
        segments: SteadySegments,
        reference: np.datetime64 | None = None,
        *,
        separate_turns: bool = False,
    ) -> None:
        self.separate_turns = separate_turns
        self.platform, self.parameters, self.segments = platform, tuple(parameters), segments
        # Cached, since a Jacobian and the slope of the flatness use the same hulls.
        self._hull_of = lru_cache(maxsize=4 * len(self.parameters) + 1)(self._displaced_hull)
        self.reference = middle_of(segments.time) if reference is None else reference
        self._seawater = segments.seawater if fits_density(platform, segments) else None
        self._days = (segments.time - self.reference) / _DAY
        always = np.ones(len(segments), dtype=bool)
        self.counted = np.column_stack([segments.straight, segments.straight, always, always])
        rows, self.kind = np.nonzero(self.counted)
        self.profile = segments.profile[rows]
        self.leg = 2 * self.profile + (segments.depth_rate[rows] > 0.0)

    def __call__(self, steps: Array) -> Array:
        """Return the errors used, SI, as a vector (m,)."""
        return np.asarray(self.all_errors(steps)[self.counted])

    def all_errors(self, steps: Array) -> Array:
        """All errors (n, 4), SI."""
        return self._balance(steps).errors

    def _balance(self, steps: Array) -> SteadyBalance:
        (balance,) = self._balances([steps])
        return balance

    def _balances(self, moves: Sequence[Array], velocity: Array | None = None) -> Iterator[SteadyBalance]:
        """Yield the balance of the hull with each of several steps."""
        hulls = zip((self.hull(steps) for steps in moves), moves, strict=True)
        for sensors, group in groupby(hulls, key=lambda hull_and_steps: hull_and_steps[0].sensors):
            with_steps = [(Glider(hull), steps) for hull, steps in group]
            gliders = [glider for glider, _ in with_steps]
            bodies = [glider.bodies(self._controls(glider.platform, steps)) for glider, steps in with_steps]
            segments = _with_sensors(self.segments, self.platform.sensors, sensors)
            yield from steady_balances(gliders, bodies, segments.motion, velocity)

    def _controls(self, hull: Platform, steps: Array) -> Array:
        controls = model_controls(hull, self.segments.actuators, self._seawater)
        controls[:, 3] += hull.buoyancy.water_density * CUBIC_CENTIMETRE * self.trend(steps) * self._days
        return controls

    def hull(self, steps: Array) -> Platform:
        """Hull with some steps; parameters that have not moved have exactly the platform's values."""
        return self._hull_of(tuple(steps.tolist()))

    def _displaced_hull(self, steps: tuple[float, ...]) -> Platform:
        moves = zip(self.parameters, steps, strict=True)
        return with_values(
            self.platform, {p.key: p.moved(self.platform, s) for p, s in moves if p is not TREND and s != 0.0}
        )

    def trend(self, steps: Array) -> float:
        """Trend of the neutral volume, cm3/day."""
        moves = zip(self.parameters, steps.tolist(), strict=True)
        return sum(p.moved(self.platform, s) for p, s in moves if p is TREND)

    def with_separate_turns(self) -> "SegmentErrors":
        """Return the same errors, in which turns do not determine the parameters of straight flight."""
        return SegmentErrors(self.platform, self.parameters, self.segments, self.reference, separate_turns=True)

    def without_profiles(self, numbers: Sequence[int]) -> "SegmentErrors":
        """Return the same errors without the segments of some profiles."""
        others = self.segments.select(~np.isin(self.segments.profile, numbers))
        return SegmentErrors(self.platform, self.parameters, others, self.reference, separate_turns=self.separate_turns)

    def parts(self) -> list[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
        """Masks of the errors (m,), and of the parameters (p,) that are fitted to them, for each separate fit."""
        turns, turning = self.kind >= _ROLL, np.isin([p.key for p in self.parameters], TURNING)
        if not self.separate_turns:
            return [(np.ones_like(turns), np.ones_like(turning))]
        return [(~turns, ~turning), (turns, turning)]

    def jacobian(self, steps: Array, columns: Sequence[int]) -> Array:
        """Derivatives (m, c) of the errors used, with respect to the parameters at some positions.

        The velocity of every displaced hull is solved for from that of the undisplaced one, which is close. Derivatives
        of a part's errors with respect to the parameters of another part are zero.
        """
        moves, velocity = DIFFERENCE * np.eye(len(self.parameters)), self._balance(steps).velocity
        balances = self._balances([steps, *(steps + moves[i] for i in columns)], velocity)
        undisplaced, *displaced = (np.asarray(balance.errors[self.counted]) for balance in balances)
        slopes = np.column_stack([(errors - undisplaced) / DIFFERENCE for errors in displaced])
        same_part = np.any([rows[:, None] & parameters[list(columns)] for rows, parameters in self.parts()], axis=0)
        return np.where(same_part, slopes, 0.0)

    def flatness(self, steps: Array, margin: float = FLATTEST_MARGIN) -> float:
        """Excess (rad) of a hull's flattest pitch, times a margin, over the flattest measured pitch; at least zero.

        At its minimum glide angle a hull's angle of attack has an infinite slope, and a fit would get stuck there.
        """
        hull = self.hull(steps)
        flattest = [
            least_glide_angle(hull, heavy=heavy) - abs(best_angle_of_attack(hull, heavy=heavy))
            for heavy in (True, False)
        ]
        return max(0.0, margin * max(flattest) - float(np.abs(self.segments.pitch).min()))

    def offsets(self) -> Array:
        """Errors (m, 4) from rounding common to all segments: of pitch and of roll, in dives and in climbs.

        An attitude that hardly changes is rounded the same way every time.
        """
        deviation = self.platform.sensors.attitude_resolution_rad / math.sqrt(12.0)
        diving = self.leg % 2 == 1
        return np.column_stack(
            [deviation * ((self.kind == kind) & (diving == phase)) for kind in _ROUNDED for phase in (True, False)]
        )

    @property
    def unfitted(self) -> tuple[HullParameter, ...]:
        """Errors (r,) to which steady glides respond and that are not fitted: of the attitude, and of the motion."""
        motion = [p for p in UNFITTED_MOTION if p.value(self.platform) != 0.0]
        return tuple(p for p in (*ATTITUDE_PARAMETERS, *motion) if p not in self.parameters)

    def by_unfitted(self, steps: Array) -> Array:
        """Derivatives (m, r) of the errors used, with respect to the errors that are not fitted."""
        extended = SegmentErrors(self.platform, (*self.parameters, *self.unfitted), self.segments, self.reference)
        count, unfitted = len(self.parameters), len(self.unfitted)
        return extended.jacobian(np.concatenate([steps, np.zeros(unfitted)]), range(count, count + unfitted))


def _with_sensors(segments: SteadySegments, before: Sensors, after: Sensors) -> SteadySegments:
    """Segments, whose attitude was corrected for the errors of some sensors, corrected for those of others instead."""
    pitch = segments.pitch / before.pitch_scale + math.radians(before.pitch_offset - after.pitch_offset)
    roll = segments.roll + math.radians(before.roll_offset - after.roll_offset)
    return replace(segments, roll=roll, pitch=after.pitch_scale * pitch)


def fits_density(platform: Platform, segments: SteadySegments) -> bool:
    """Return whether buoyancy uses measured density: the hull has a compressibility, and the density is known."""
    return platform.buoyancy.compressibility is not None and bool(segments.in_known_water.all())


def steady_parameters(platform: Platform, segments: SteadySegments) -> tuple[HullParameter, ...]:
    """Parameters that steady glides may determine, for buoyancy by density or by depth slope.

    They include the offset of the roll, which turns reveal; without it, the fit would change the lateral terms instead.
    A hull steered by a rudder is an exception, because an offset of the rudder would have the same effect.
    """
    steady = PARAMETERS_BY_DENSITY if fits_density(platform, segments) else PARAMETERS
    return steady if segments.actuators[:, 3].any() else (*steady, ROLL_OFFSET)


def middle_of(time: NDArray[np.datetime64]) -> np.datetime64:
    """Time halfway between the first and the last."""
    first, last = time.min(), time.max()
    middle: np.datetime64 = first + (last - first) // 2
    return middle


MIN_SHARE = 0.5
"""Minimum fraction of segments with a known density for which the density is used."""


def choose_buoyancy(
    platform: Platform,
    segments: SteadySegments,
    held_out: SteadySegments,
    choice: Literal["auto", "density", "depth_slope"],
    report: Callable[[str], None] = lambda _: None,
) -> tuple[Platform, SteadySegments, SteadySegments]:
    """Prepare hull and segments for buoyancy by density or by depth slope, since the neutral volume differs.

    Parameters
    ----------
    platform : Platform
        The hull to start from.
    segments, held_out : SteadySegments
        Segments to fit and segments to score.
    choice : str
        Value of the setting ``seawater``.
    report : callable
        Called with a line of text on data that are left out or not used, with the reason.

    Returns
    -------
    platform, segments, held_out
        Hull and segments. By density, the hull has a compressibility, and segments in unknown water are left out. By
        depth slope, the hull has no compressibility, since its neutral volume will not belong to a density.

    Notes
    -----
    Without a compressibility, the neutral volume of a platform applies to the water in which it flew. In fresh or
    brackish water the density of the platform file is therefore replaced by the observed one, at the surface.

    Raises
    ------
    InputError
        Density is requested, and no segment has one.
    """
    known = segments.in_known_water
    if choice == "density" and not known.any():
        raise InputError(
            "`seawater=density`: no steady flight of the chosen profiles has a known density; give "
            "`seawater=depth_slope`"
        )
    profiles = len(np.unique(segments.profile[known]))
    is_enough = profiles >= MIN_PROFILES and known.mean() >= MIN_SHARE
    if choice == "density" or (choice == "auto" and is_enough):
        for number in np.unique(segments.profile[~known]):
            reason = _without_seawater(segments.select(segments.profile == number))
            report(f"profile {number} is left out: the density of its water is not known" + _in_brackets(reason))
        usable = segments.select(known)
        return _in_its_water(platform, usable, report), usable, held_out.select(held_out.in_known_water)
    if choice == "auto":
        share = f"only {known.mean():.0%} of the steady flight, in {counted(profiles, 'profile')}, has"
        reason = _without_seawater(segments.select(~known))
        report(
            f"buoyancy from the depth slope: {share if known.any() else 'no steady flight has'} a known density"
            + _in_brackets(reason)
        )
    if platform.buoyancy.compressibility is not None:
        platform = with_values(platform, {"buoyancy.compressibility": None})
    return platform, _in_unknown_water(segments), _in_unknown_water(held_out)


def _in_its_water(platform: Platform, segments: SteadySegments, report: Callable[[str], None]) -> Platform:
    """Return a compressible hull; one that stated no compressibility is neutral in the water of the segments."""
    hull = compressible(platform)
    if platform.buoyancy.compressibility is not None:
        return hull
    surface = surface_density(segments.seawater)
    if not is_unexpected_density(hull, surface):
        return hull
    report(
        f"the water density is {surface:.1f} kg/m3 (median of the steady flight, at surface pressure), that of the "
        f"platform file {hull.buoyancy.water_density:g}: its neutral volume is referred to this density "
        "(buoyancy.water_density)"
    )
    return with_values(hull, {"buoyancy.water_density": round(surface, 1)})


def _without_seawater(segments: SteadySegments) -> str:
    """Reason why the density is not known, the most frequent one of the profiles; empty if none is recorded."""
    numbers, first = np.unique(segments.profile, return_index=True)
    reasons = [str(reason) for reason in segments.without_seawater[first] if reason]
    return most_frequent_reason(reasons) if len(numbers) and reasons else ""


def _in_brackets(reason: str) -> str:
    return f" ({reason})" if reason else ""


def _in_unknown_water(segments: SteadySegments) -> SteadySegments:
    return replace(segments, seawater=np.full_like(segments.seawater, np.nan))
