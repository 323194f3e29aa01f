"""Sweeps of the sensitivity kernel over a profile: arrays allocated, the kernel called, results without its padding."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.smoother.problem import Trajectory
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels import sensitivity as kernel
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.sensitivity_memory import (
    Assumptions,
    ErrorInformation,
    Forcing,
    SmoothedSensitivity,
    allocate_information,
    allocate_scratch,
    allocate_smoothed,
    allocate_tape,
)
from gliderhpc.kernels.smoother import run_path
from gliderhpc.kernels.smoother_allocation import allocate_segments
from gliderhpc.kernels.smoother_memory import LOG_DETERMINANT, SmootherProblem

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

_MAX_DEVIATIONS = np.array([1.0, 1.0, np.pi, 50.0, 1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
"""Largest deviations of the filter from the smoothed path with which the hull can still fly: roll, pitch, heading
(rad), depth (m), velocity (m/s) and rates (rad/s)."""


def sum_information(
    hull: Hull, assumed: Sequence[SmootherProblem], forcing: Forcing, trajectory: Trajectory, rows: Rows
) -> tuple[ErrorInformation, ...]:
    """Information and score about a trajectory, from the forward sweep alone, under each assumption of the noise.

    Inside the segments between ``rows`` (`segment_rows`), the trajectory is replaced by the model's run.
    """
    informations, _ = _sweep(hull, assumed, forcing, trajectory, rows, np.empty(0, dtype=np.int64))
    return informations


def sensitivity_sweeps(
    hull: Hull, problem: SmootherProblem, forcing: Forcing, trajectory: Trajectory, rows: Rows, requested: Rows
) -> tuple[ErrorInformation, SmoothedSensitivity]:
    """Information and score about a trajectory, and sensitivities of the smoothed states at the ``requested`` rows.

    Inside the segments between ``rows`` (`segment_rows`), the trajectory is replaced by the model's run.
    """
    informations, smoothed = _sweep(hull, (problem,), forcing, trajectory, rows, requested)
    return informations[0], smoothed


def _sweep(
    hull: Hull,
    assumed: Sequence[SmootherProblem],
    forcing: Forcing,
    trajectory: Trajectory,
    rows: Rows,
    requested: Rows,
) -> tuple[tuple[ErrorInformation, ...], SmoothedSensitivity]:
    """Sweep forwards under each assumption, and backwards under the first one if any rows are requested."""
    segments, parameters, requested = len(rows) - 1, len(forcing.start), np.asarray(requested, dtype=np.int64)
    information = allocate_information(len(assumed), segments, parameters)
    out = allocate_smoothed(requested, parameters)
    samples, channels, _ = forcing.samples.shape
    taped = len(requested) > 0
    tape = allocate_tape(taped * segments, taped * samples, channels, len(requested), parameters)
    kernel.sum_information(
        hull, assumed[0], Assumptions(*(np.stack(column) for column in _columns(assumed))), forcing,
        trajectory.states, trajectory.disturbances, allocate_scratch(rows, forcing, len(assumed)), information, tape,
        out,
    )  # fmt: skip
    # Without the columns that fill the parameters up to a multiple of eight.
    used = slice(parameters)
    informations = tuple(
        ErrorInformation(matrix[used, used], score[used], filtered)
        for matrix, score, filtered in zip(*information, strict=True)
    )
    smoothed = SmoothedSensitivity(requested, out.states[..., used], out.track[..., used], out.displacement[:, used])
    return informations, smoothed


def _columns(assumed: Sequence[SmootherProblem]) -> tuple[list[Array], ...]:
    return [d.measured for d in assumed], [d.variance for d in assumed], [d.noise for d in assumed]


# Path of a filter about the smoothed path


def moved(hull: Hull, problem: SmootherProblem, path: Trajectory, rows: Rows, deviations: Array) -> Trajectory:
    """Move a path by deviations ``(s+1, 16)`` of its sensed states and disturbances in the rows between segments.

    Inside a segment, the disturbances' deviations decay from its first row on, and the states are the model's run.
    """
    states, disturbances = path.states.copy(), path.disturbances.copy()
    states[np.ix_(rows, SENSED)] += deviations[:, :10]
    steps = np.arange(len(disturbances))
    segment = np.searchsorted(rows, steps, side="right") - 1
    disturbances += problem.decay ** (steps - rows[segment])[:, None] * deviations[segment, 10:]
    run_path(hull, problem, states, disturbances, allocate_segments(rows), np.zeros(LOG_DETERMINANT + 1))
    return Trajectory(states, disturbances)


def without_far_rows(deviations: Array) -> Array:
    """Set the filter's deviations ``(s+1, 16)`` from the smoothed path to zero in rows with one over `_MAX_DEVIATIONS`.

    Near rest, or about the path of a wrong hull, a linearised filter may be in error by radians and metres per second,
    and a step from there may not be finite.
    """
    is_near = np.asarray(np.all(np.abs(deviations[:, :10]) <= _MAX_DEVIATIONS, axis=1))
    return np.where(is_near[:, None], deviations, 0.0)
