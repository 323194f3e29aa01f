"""Allocation of the smoother's memory for one profile (`gliderhpc.kernels.smoother_memory`)."""

from typing import Any

import numpy as np

from gliderhpc.kernels.elementwise import LANES, lane_array
from gliderhpc.kernels.jacobian import ENTRIES
from gliderhpc.kernels.smoother_memory import BLOCK, Backward, Block, SegmentLanes, Segments, Tape

Array = Any


def aligned(*shape: int) -> Array:
    """Return zeros of a shape whose last axis is a whole number of vectors, aligned to a vector register."""
    return lane_array(*shape[:-1], shape[-1] // LANES).reshape(shape)


def allocate_block() -> Block:
    """Allocate the memory of one block."""
    m = BLOCK + 1
    seeds = aligned(10, 24)
    seeds[:, :20] = np.tile(np.eye(10), 2)
    return Block(
        mean=aligned(m, 16), covariance=aligned(m, 16, 16), cross=aligned(m, 2, 16), track=np.zeros((m, 2, 2)),
        tangent=aligned(m, 16, 16), track_tangent=aligned(m, 2, 16), gain=aligned(m, 10, 16),
        scaled_innovation=np.zeros((m, 10)), information=np.zeros((m, 10)), seeds=seeds,
        columns=aligned(16, 32), half=aligned(16, 16), ahead=aligned(16, 16), behind=aligned(16, 16),
    )  # fmt: skip


def allocate_segments(rows: Array, represented_steps: Array = (), *, whole: bool = False) -> Segments:
    """Allocate the memory of a profile's segments, for the fields `rows` and `represented_steps` of `Segments`.

    The products of all segments are stored only if `whole` is set, else those of one block.
    """
    longest = int(np.diff(rows).max())
    return Segments(
        rows=np.ascontiguousarray(rows, dtype=np.int64),
        represented_steps=np.ascontiguousarray(represented_steps, dtype=np.int64),
        noise=aligned(BLOCK, 16, 16), noise_cross=aligned(BLOCK, 2, 16), noise_track=np.zeros((BLOCK, 2, 2)),
        offset=aligned(BLOCK, 16), by_noise=aligned(LANES, longest, 11, 8),
        lanes=_allocate_lanes(longest, -(-(len(rows) - 1) // LANES) if whole else BLOCK // LANES), half=aligned(3, 8),
    )  # fmt: skip


def _allocate_lanes(longest: int, groups: int) -> SegmentLanes:
    return SegmentLanes(
        durations=lane_array(longest), bodies=lane_array(longest, 11), disturbances=lane_array(longest, 6),
        noise=lane_array(longest, 6), defects=lane_array(longest, 6), states=lane_array(longest + 1, 12),
        transition=lane_array(12, 16), remaining=lane_array(6), gathered=lane_array(12, 12),
        gathered_cross=lane_array(6, 12), gathered_own=lane_array(6), offset=lane_array(16), after=lane_array(10, 16),
        by_noise=lane_array(groups, longest - 1, 10, 6), by_own=lane_array(groups, longest, 6),
        track_by_noise=lane_array(BLOCK // LANES, longest - 1, 2, 6),
        partials=lane_array(longest, 4, ENTRIES), track_partials=lane_array(longest, 4, 3, 6),
        stages=lane_array(longest, 4, 10), stage_costates=lane_array(4, 12, 10),
    )  # fmt: skip


def allocate_tape(fed: Array, represented_steps: Array) -> Tape:
    """Allocate the tape, from the mask of the rows between segments with a sample and `Segments.represented_steps`."""
    n, shifted = len(fed), np.asarray(represented_steps) > 0
    samples, shifts = int(np.sum(fed)), int(np.sum(shifted))
    return Tape(
        mean=aligned(n, 16), covariance=aligned(n, 16, 16), cross=aligned(n, 2, 16), track=np.zeros((n, 2, 2)),
        transition=aligned(n - 1, 11, 16), sample=_numbers(fed), gain=aligned(samples, 10, 16),
        scaled_innovation=np.zeros((samples, 10)), information=np.zeros((samples, 10)), shift=_numbers(shifted),
        after=aligned(shifts, 16, 16),
    )  # fmt: skip


def _numbers(chosen: Array) -> Array:
    """Return the index of each chosen element among the chosen; for others, that of the preceding one (or zero)."""
    return np.maximum(np.cumsum(chosen, dtype=np.int64) - 1, 0)


def allocate_backward(segments: int, steps: int, rows: Any = (), *, mean_shift: bool = False) -> Backward:
    """Allocate the memory for the results of the backward sweep.

    The full covariance is computed in `rows`, and the mean shift only if it is requested.
    """
    wanted = np.asarray(rows, dtype=np.int64)
    n = segments + 1
    return Backward(
        np.zeros((n, 16)), np.zeros((n, 10)), np.zeros((n, 6)), np.zeros((n, 2)), np.zeros((steps, 6)),
        np.zeros((steps, 6)), np.zeros(10), np.zeros((2, 2)), np.zeros((n if mean_shift else 0, 16)),
        wanted, np.zeros((len(wanted), 18, 18)),
    )  # fmt: skip


def allocate_costate() -> tuple[Array, Array]:
    """Allocate the memory for the costate and for its covariance."""
    return aligned(16), aligned(16, 16)
