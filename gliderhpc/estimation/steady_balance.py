"""The balance of forces and moments in steady flight, straight or turning, at the measured attitude and motion.

Roll, pitch, rate of turn, depth and depth rate are measured; the velocity is not, and is eliminated. Its vertical
component is the depth rate, and the other two follow from the two horizontal forces, which do not contain the weight.
The vertical force and the three moments remain. They are converted to errors of the measurements: the depth rate from
the vertical force, pitch from the pitch moment, roll and rate of turn together from the other two.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.self_motion import angle_of_attack
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import best_angle_of_attack
from gliderhpc.kernels.jacobian import ENTRIES, ENTRY_COLUMN, ENTRY_ROW
from gliderhpc.kernels.points import rates_and_partials
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

ITERATIONS = 12
"""Maximum number of Newton steps for the velocity."""

LARGEST_STEP = 0.1
"""Maximum change of the velocity in a step, as a fraction of the speed."""

CONVERGED = 1e-9
"""Step length (m/s) below which the iteration ends; convergence is quadratic."""

MIN_RATIO = 0.25
"""Ratio ``W / -F.k`` (`steady_balances`) below which its square root is continued by the tangent."""

VELOCITY, RATES = slice(4, 7), slice(7, 10)
PITCHING, LATERAL = 8, np.array([7, 9])
"""Indices of the pitch acceleration, and of those of roll and yaw, among the rates."""

_MIN_VELOCITY_STEP = 1e-300
_MIN_STEEPNESS = 0.05


@dataclass(frozen=True, eq=False)
class MeasuredAttitude:
    """Measurements of n samples without the vertical motion.

    Attributes
    ----------
    roll, pitch : (n,)
        Roll and pitch, rad.
    turn_rate : (n,)
        Rate of the heading, rad/s.
    depth : (n,)
        Depth, m, on which the hull's buoyancy depends.
    """

    roll: Array
    pitch: Array
    turn_rate: Array
    depth: Array

    def select(self, chosen: NDArray[np.bool_]) -> "MeasuredAttitude":
        """Return the chosen samples."""
        return MeasuredAttitude(*(values[chosen] for values in (self.roll, self.pitch, self.turn_rate, self.depth)))


@dataclass(frozen=True, eq=False)
class SteadyMotion(MeasuredAttitude):
    """Measurements of n stretches of steady flight.

    Attributes
    ----------
    depth_rate : (n,)
        Depth rate, m/s, positive down.
    """

    depth_rate: Array

    def repeated(self, times: int) -> "SteadyMotion":
        """Repeat all stretches several times, in sequence."""
        return SteadyMotion(**{field.name: np.tile(getattr(self, field.name), times) for field in fields(self)})


@dataclass(frozen=True, eq=False)
class SteadyBalance:
    """Balance of a hull over n stretches.

    Attributes
    ----------
    errors : (n, 4)
        Predicted less measured depth rate (m/s), pitch, roll (rad) and rate of turn (rad/s), in the order of
        `QUANTITIES`.
    velocity : (n, 3)
        Velocity through the water u, v, w at which the balance is evaluated, m/s. On a path flatter than the hull's
        minimum glide angle it lies on the back of the drag curve, if it exists.
    """

    errors: Array
    velocity: Array


QUANTITIES = ("depth rate", "pitch", "roll", "turn rate")


_MAX_ROWS = 4096
"""Maximum number of stretches, over all hulls, that are solved together."""


def steady_balances(
    gliders: Sequence[Glider], bodies: Sequence[Array], motion: SteadyMotion, velocity: Array | None = None
) -> Iterator[SteadyBalance]:
    """Yield the comparison of the steady balance of each of several hulls with the same measured steady flight.

    Parameters
    ----------
    gliders : sequence of Glider
        The hulls.
    bodies : sequence of (n, 11)
        Mass properties of the controls for each hull (`Glider.bodies`).
    motion : SteadyMotion
        Measured motion in n stretches.
    velocity : (n, 3), optional
        Velocity u, v, w from which all hulls start, m/s, such as a similar hull's; by default that of a straight glide
        of each hull.

    Notes
    -----
    In steady flight the six accelerations of eq. 20 vanish. Roll and pitch are constant, and the rates are ``psi'
    [-sin(theta), sin(phi) cos(theta), cos(phi) cos(theta)]``. With F the force without weight and k the vertical,
    ``W + F.k`` is the remaining vertical force. F is nearly proportional to the square of the depth rate, and the depth
    rate that balances is therefore ``sqrt(W / -F.k)`` times the measured one. Moments are converted to angles by one
    Newton step in which the velocity follows. The attitude is predicted rather than balanced, since disturbances of a
    measured attitude would look like a weaker righting moment. Roll and turn are predicted together from the controls,
    because a turn that the water causes also rolls the hull.
    """
    batch_size = max(1, _MAX_ROWS // max(1, len(motion.pitch)))
    for first in range(0, len(gliders), batch_size):
        batch = slice(first, first + batch_size)
        flight = SteadyFlight(gliders[batch], bodies[batch], motion, velocity)
        flight.solve_velocity()
        errors = (flight.depth_rate_error(), flight.pitch_error(), flight.lateral_errors())
        count = len(flight.gliders)
        results = (np.column_stack(errors), flight.states[:, VELOCITY])
        yield from map(SteadyBalance, *(np.split(values, count) for values in results))


@dataclass(frozen=True, eq=False)
class _Frame:
    """Directions in the body frame, each (n, 3): down, ahead and across (both level), and derivatives by the angles."""

    down: Array
    ahead: Array
    across: Array
    by_roll: tuple[Array, Array, Array]
    by_pitch: tuple[Array, Array, Array]


class SteadyFlight:
    """Steady states of stretches of flight, with rates and derivatives, during the solution for the velocity.

    Several hulls fly the same n stretches; the rows (h n, ...) are those of the first hull, then of the next.
    """

    def __init__(
        self, gliders: Sequence[Glider], bodies: Sequence[Array], motion: SteadyMotion, velocity: Array | None
    ) -> None:
        self.gliders, self._bodies = gliders, bodies
        count = len(motion.pitch)
        if velocity is None:
            velocities = [_straight_glide_velocity(glider.platform, motion) for glider in gliders]
        else:
            velocities = [velocity] * len(gliders)
        self._rows = [slice(hull * count, (hull + 1) * count) for hull in range(len(gliders))]
        self._motion = motion.repeated(len(gliders))
        self._frame = _frame_of(self._motion)
        self._masses = np.repeat([glider.hull[:3] for glider in gliders], count, axis=0)
        self.states = _states(self._motion, self._frame.down, np.concatenate(velocities))
        self._evaluate()

    def solve_velocity(self) -> None:
        """Solve by Newton's method for the velocity with the measured depth rate and no horizontal force.

        A hull whose velocities have all converged is not changed further, even if other hulls need more steps.
        """
        moving = np.ones(len(self.gliders), dtype=bool)
        for _ in range(ITERATIONS):
            step = _solve(self._by_velocity, -self.missing)
            speed, length = (np.linalg.norm(x, axis=1) for x in (self.states[:, VELOCITY], step))
            shortened = np.minimum(1.0, LARGEST_STEP * speed / np.maximum(length, _MIN_VELOCITY_STEP))
            for hull in np.flatnonzero(moving):
                rows = self._rows[hull]
                self.states[rows, VELOCITY] += step[rows] * shortened[rows, None]
                # NaN never counts as converged: a hull with NaN in one stretch keeps iterating for the others.
                moving[hull] = not length[rows].max(initial=0.0) < CONVERGED
            self._evaluate()
            if not moving.any():
                break

    def depth_rate_error(self) -> Array:
        """Depth rate (n,) at which the vertical force vanishes, less the measured one, m/s (`steady_balances`)."""
        depth = self._motion.depth
        weights = [
            glider.net_weight(bodies, depth[rows])
            for glider, bodies, rows in zip(self.gliders, self._bodies, self._rows, strict=True)
        ]
        weight = np.concatenate(weights)
        ratio = weight / (weight - _dot(self._force, self._frame.down))
        known = np.maximum(ratio, MIN_RATIO)
        root = np.sqrt(known) + 0.5 * (ratio - known) / np.sqrt(known)
        return np.asarray((root - 1.0) * self._motion.depth_rate)

    def pitch_error(self) -> Array:
        """Pitch (n,) at which the pitch moment vanishes, less the measured one, rad."""
        slope = self._total_derivatives(self._by_angle(1, self._frame.by_pitch))
        return np.asarray(-self._values[:, PITCHING] / slope[:, PITCHING])

    def lateral_errors(self) -> Array:
        """Errors (n, 2) of roll and rate of turn, by one Newton step of both for both moments."""
        turning = _product(self._jacobian[:, :, RATES], self._frame.down)
        slopes = [
            self._total_derivatives(partials)
            for partials in (self._by_angle(0, self._frame.by_roll), (turning, self._missing_by(turning)))
        ]
        return _solve(np.stack([slope[:, LATERAL] for slope in slopes], axis=2), -self._values[:, LATERAL])

    def _total_derivatives(self, partials: tuple[Array, Array]) -> Array:
        """Total derivatives (n, 10) of the rates with respect to an angle; the velocity keeps `missing` unchanged."""
        rates, missing = partials
        return rates + _product(self._jacobian[:, :, VELOCITY], _solve(self._by_velocity, -missing))

    def _by_angle(self, column: int, frame: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        """Derivatives of rates and `missing` with respect to roll or pitch, at fixed rate of turn and velocity."""
        down, ahead, across = frame
        turning = _product(self._jacobian[:, :, RATES], down * self._motion.turn_rate[:, None])
        rates = self._jacobian[:, :, column] + turning
        missing = self._missing_by(rates)
        missing[:, 1] += _dot(ahead, self._force)
        missing[:, 2] += _dot(across, self._force)
        return rates, missing

    def _missing_by(self, rates: Array) -> Array:
        """Depth rate and horizontal forces (n, 3) from rates (or from derivatives of rates), at fixed directions."""
        force = rates[:, VELOCITY] * self._masses
        return np.column_stack([rates[:, 3], _dot(self._frame.ahead, force), _dot(self._frame.across, force)])

    def _evaluate(self) -> None:
        n = len(self.states)
        self._values, entries = np.empty((n, 10)), np.empty((n, ENTRIES))
        for glider, bodies, rows in zip(self.gliders, self._bodies, self._rows, strict=True):
            rates_and_partials(glider.hull, bodies, self.states[rows], self._values[rows], entries[rows])
        self._jacobian = np.zeros((n, 10, 10))
        self._jacobian[:, ENTRY_ROW, ENTRY_COLUMN] = entries
        self._force = self._values[:, VELOCITY] * self._masses
        self.missing = self._missing_by(self._values)
        self.missing[:, 0] -= self._motion.depth_rate
        self._by_velocity = np.stack([self._missing_by(self._jacobian[:, :, i]) for i in (4, 5, 6)], axis=2)


def _frame_of(motion: SteadyMotion) -> _Frame:
    sp, cp, st, ct = np.sin(motion.roll), np.cos(motion.roll), np.sin(motion.pitch), np.cos(motion.pitch)
    zero = np.zeros_like(sp)
    down = np.column_stack([-st, sp * ct, cp * ct])
    ahead = np.column_stack([ct, sp * st, cp * st])
    across = np.column_stack([zero, cp, -sp])
    below = np.column_stack([zero, -sp, -cp])
    return _Frame(
        down, ahead, across, (ct[:, None] * across, st[:, None] * across, below), (-ahead, down, np.zeros_like(down))
    )


def _straight_glide_velocity(platform: Platform, motion: SteadyMotion) -> Array:
    """Velocity (n, 3) of a straight glide, m/s; at minimum drag-to-lift ratio where there is no glide."""
    best = np.where(motion.depth_rate > 0.0, *(best_angle_of_attack(platform, heavy=heavy) for heavy in (True, False)))
    alpha = angle_of_attack(platform, motion.pitch)
    alpha = np.where(np.isnan(alpha), best, alpha)
    steepness = np.maximum(np.abs(np.sin(motion.pitch - alpha)), _MIN_STEEPNESS)
    speed = np.abs(motion.depth_rate) / steepness
    return np.column_stack([speed * np.cos(alpha), np.zeros_like(speed), speed * np.sin(alpha)])


def _states(motion: SteadyMotion, down: Array, velocity: Array) -> Array:
    """Sensed states (n, 10) with a velocity (n, 3)."""
    zero = np.zeros_like(motion.pitch)
    return np.column_stack([motion.roll, motion.pitch, zero, motion.depth, velocity, motion.turn_rate[:, None] * down])


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ni,ni->n", a, b))


def _product(matrices: Array, vectors: Array) -> Array:
    return np.asarray(np.einsum("nij,nj->ni", matrices, vectors))


def _solve(matrices: Array, vectors: Array) -> Array:
    return np.asarray(np.linalg.solve(matrices, vectors[:, :, None])[:, :, 0])
