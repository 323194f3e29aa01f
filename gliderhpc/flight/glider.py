"""Six-degree-of-freedom glider: interface between callers' arrays and the compiled kernels; loading of platforms."""

from collections.abc import Mapping
from numbers import Real
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gliderhpc.errors import InputError, first_line
from gliderhpc.flight.hull_parameters import check_uncertainty
from gliderhpc.flight.packing import hull_of, mass_properties, masses_of
from gliderhpc.flight.steady_glide import glides_stably
from gliderhpc.kernels import points as point
from gliderhpc.kernels import window
from gliderhpc.kernels.jacobian import rhs_jacobian
from gliderhpc.kernels.parameters import Body
from gliderhpc.platform import Platform, read_platform, with_overrides
from gliderhpc.platform_ranges import check_plausible

Array = NDArray[np.float64]

NET_WEIGHT = Body._fields.index("net_weight")
"""Index of the net weight among the mass properties."""

SENSED = np.array([0, 1, 2, 5, 6, 7, 8, 9, 10, 11])
"""Indices of the ten sensed states among the twelve of eq. 16 (all but X and Y)."""


def checked(name: str, value: ArrayLike, *shape: int | None) -> Array:
    """Coerce to contiguous float64; check the shape (None: any length) and that all values are finite.

    Raises
    ------
    InputError
        The shape differs, or a value is not a number or not finite; the message names the argument and the fault.
    """
    array = np.ascontiguousarray(numbers(name, value))
    if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
        wanted = "(" + ", ".join("n" if n is None else str(n) for n in shape) + ")"
        raise InputError(f"{name} has shape {array.shape}; it must be {wanted}")
    if not np.isfinite(array).all():
        first = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InputError(f"{name}{list(first)} is {array[first]}; every value must be finite")
    return array


def numbers(name: str, value: ArrayLike) -> Array:
    """Coerce to float64.

    Raises
    ------
    InputError
        The rows differ in length or a value is not a number; the message names the argument.
    """
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is not an array of numbers: {first_line(error)}") from None


class Glider:
    """Flight model of one platform (eqs. 1-14 and 20).

    Parameters
    ----------
    platform : Platform, str or Path
        A hull from `gliderhpc.load_platform`, the name of a shipped one, or the path of a platform file.

    Raises
    ------
    InputError
        A name or a path is given that `gliderhpc.load_platform` refuses.

    Notes
    -----
    State ``[phi, theta, psi, X, Y, Z, u, v, w, p, q, r]`` (rad, m, m/s, rad/s; NED, Z down). Control ``[r_px, gamma,
    m_b, m_m]`` (m, rad, kg, kg), optionally with the rudder's angle (rad) as a fifth and an additional weight
    ``m_x g`` (N, `gliderhpc.flight.buoyancy.excess_weight`) as a sixth. Disturbance ``[B_cu, B_cv, B_cw,
    B_cp, B_cq, B_cr]`` (N and N m), constant over a step.
    """

    def __init__(self, platform: Platform | str | Path) -> None:
        if not isinstance(platform, Platform):
            platform = load_platform(platform)
        self.platform = platform
        self.hull = hull_of(platform)
        self.masses = masses_of(platform)

    def bodies(self, controls: ArrayLike) -> Array:
        """Mass properties ``(n, 11)`` of controls ``(n, 4)`` to ``(n, 6)`` (eqs. 5 and 9)."""
        array = numbers("controls", controls)
        if array.ndim != 2 or array.shape[1] not in (4, 5, 6):
            raise InputError(f"controls has shape {array.shape}; it must be (n, 4), (n, 5) or (n, 6)")
        array = checked("controls", np.column_stack([array, np.zeros((len(array), 6 - array.shape[1]))]), None, 6)
        bodies = mass_properties(self.masses, array)
        bodies[:, NET_WEIGHT] += array[:, 5]
        return bodies

    def net_weight(self, bodies: Array, depth: Array) -> Array:
        """Weight in water ``(n,)`` of mass properties ``(n, 11)`` at depths (m), N, positive heavy."""
        return np.asarray(bodies[:, NET_WEIGHT] - self.hull.depth_slope * depth)

    def input_diagonal(self) -> Array:
        """Diagonal ``(6,)`` of the constant block df/db of eq. 20: reciprocal effective masses and inertias."""
        return 1.0 / np.array(self.hull[:6])

    def rhs(self, state: ArrayLike, control: ArrayLike, disturbance: ArrayLike) -> Array:
        """Time derivative of the state (eqs. 1, 2, 6, 20).

        Parameters
        ----------
        state : (12,)
            State, in rad, m, m/s and rad/s.
        control : (4,)
            Control, in m, rad, kg and kg; or (5,), (6,) as in the notes of the class.
        disturbance : (6,)
            Disturbance, in N and N m.

        Returns
        -------
        (12,) array
            Derivative, in rad/s, m/s, m/s2 and rad/s2.

        Raises
        ------
        InputError
            A shape differs or a value is not finite.
        """
        y = checked("state", state, 12)
        b = checked("disturbance", disturbance, 6)
        out = np.empty(12)
        point.rhs(self.hull, self._body(control), y, b, out)
        return out

    def jacobian(self, state: ArrayLike, control: ArrayLike) -> Array:
        """Derivative df/dy ``(12, 12)`` of `rhs` at a state (12,) and control (4,); the disturbance does not enter."""
        y = checked("state", state, 12)
        out = np.empty((12, 12))
        rhs_jacobian(self.hull, self._body(control), y, out)
        return out

    def simulate(self, state0: ArrayLike, controls: ArrayLike, disturbances: ArrayLike, step: float) -> Array:
        """Trajectory by RK4 under controls and disturbances that are constant over each step.

        Parameters
        ----------
        state0 : (12,)
            State at the start.
        controls, disturbances : (n, 4), (n, 6)
            Controls and disturbances, one row for each step.
        step : float
            Length of a step, s.

        Returns
        -------
        (n+1, 12) array
            The state at the start and after each step.

        Raises
        ------
        InputError
            A shape differs, a value is not finite, or the step is not above zero.
        """
        y0 = checked("state0", state0, 12)
        bodies = self.bodies(controls)
        b = checked("disturbances", disturbances, len(bodies), 6)
        trajectory = np.empty((len(b) + 1, 12))
        window.simulate(self.hull, bodies, y0, b, _positive("step", step), trajectory)
        return trajectory

    def tracking_cost(
        self,
        state0: ArrayLike,
        controls: ArrayLike,
        disturbances: ArrayLike,
        measurements: ArrayLike,
        step: float,
        *,
        weights: ArrayLike | None = None,
    ) -> tuple[float, Array]:
        """Cost of eq. 28 over a window and its exact gradient.

        Parameters
        ----------
        state0 : (12,)
            State at the window's start.
        controls, disturbances : (n, 4), (n, 6)
            Controls and disturbances, one row for each step.
        measurements : (n+1, 4)
            ``[phi, theta, psi, Z]`` in rad and m; row 0 is not used.
        step : float
            Length of a step, s.
        weights : (n+1,), optional
            Weights of the samples: 0 masks a sample (a gap in the record), 1 uses it.

        Returns
        -------
        cost : float
            Cost, in rad2 s and m2 s.
        gradient : (n, 6)
            Gradient dJ/db of the discrete cost, exact to rounding.

        Raises
        ------
        InputError
            A shape differs, a value is not finite, or the step is not above zero.
        """
        y0 = checked("state0", state0, 12)
        bodies = self.bodies(controls)
        n = len(bodies)
        b = checked("disturbances", disturbances, n, 6)
        w = np.ones(n + 1) if weights is None else checked("weights", weights, n + 1)
        measured = numbers("measurements", measurements).copy()
        if measured.shape == (n + 1, 4):
            # The first row and samples of zero weight (gaps) are not compared, so their values may be NaN.
            measured[(w == 0.0) | (np.arange(n + 1) == 0)] = 0.0
        measured = checked("measurements", measured, n + 1, 4)
        states, tape = np.empty((n + 1, 10)), np.empty((n, window.TAPE))
        gradient, gradient0, cost = np.empty((n, 6)), np.empty(10), np.empty(1)
        window.cost_and_gradient(
            self.hull, bodies, y0[SENSED][None], b, measured, w, _positive("step", step),
            states, tape, gradient, gradient0, cost,
        )  # fmt: skip
        return float(cost[0]), gradient

    def _body(self, control: ArrayLike) -> Array:
        """Mass properties ``(1, 11)`` of one control ``(4,)`` to ``(6,)``."""
        row = numbers("control", control)
        if row.shape not in ((4,), (5,), (6,)):
            raise InputError(f"control has shape {row.shape}; it must be (4,), (5,) or (6,)")
        return self.bodies(row[None])


def _positive(name: str, value: float) -> float:
    if not isinstance(value, Real):
        raise InputError(f"{name} is {value!r}; it must be a number")
    if not 0.0 < value < np.inf:
        raise InputError(f"{name} is {value}; it must be {'finite' if value > 0.0 else 'above zero'}")
    return float(value)


def load_platform(name_or_path: str | Path, overrides: Mapping[str, str] | None = None) -> Platform:
    """Read a platform, apply overrides, and refuse a hull that cannot glide.

    Parameters
    ----------
    name_or_path : str or Path
        A shipped hull's name or the path of a platform file.
    overrides : mapping of str to str, optional
        Dotted keys with values as YAML, ``{"buoyancy.neutral_volume": "-215"}``.

    Returns
    -------
    Platform

    Raises
    ------
    InputError
        The platform cannot be read (see :func:`gliderhpc.platform.read_platform`), an override or an uncertainty is
        invalid, or the hull has no stable steady dive or no stable steady climb.
    """
    platform = with_overrides(read_platform(name_or_path), overrides or {})
    check_plausible(str(name_or_path), platform)
    check_uncertainty(platform)
    if not glides_stably(Glider(platform)):
        raise InputError(
            f"{name_or_path}: this hull has no stable steady dive and climb at usual ballast and pitch; "
            "check that its masses hang below the centre of buoyancy (z positive), its damping, and K_M and K_MY"
        )
    return platform
