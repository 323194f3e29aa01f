"""Ocean models from files: velocities at any place and time that the files cover."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import InputError
from gliderhpc.observations.times import SECOND
from gliderhpc.studies.library.model_file import Axis, Cells, ModelFile, is_url, open_model_file
from gliderhpc.studies.library.tracks import DivePath

Array = NDArray[np.float64]

HOLE = 2.5
"""Longest interval between two times, in median intervals of the model, across which velocities are interpolated."""


class Coverage(IntEnum):
    """Outcome of sampling a model at a place (of several grids, the lowest): a velocity, or why there is none."""

    VELOCITY = 0
    LAND = 1
    DEPTH = 2
    TIME = 3
    BOX = 4


@dataclass(frozen=True, eq=False)
class Samples:
    """A model's velocity along a path.

    Attributes
    ----------
    velocity : (n, 2) array
        North and east components, m/s; NaN where the model has no velocity.
    coverage : (n,) int array
        Values of `Coverage`.
    """

    velocity: Array
    coverage: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Grid:
    """Files of one model on the same horizontal and vertical grid, joined along time.

    Attributes
    ----------
    files : sequence of ModelFile
        Files in order of appearance.
    """

    files: Sequence[ModelFile]

    def fits(self, file: ModelFile) -> bool:
        """Return whether a file has the same product and grid."""
        first = self.files[0]
        return first.product == file.product and all(
            np.array_equal(getattr(first, name).values, getattr(file, name).values)
            for name in ("depth", "latitude", "longitude")
        )

    def sample(self, path: DivePath) -> Samples:
        """Interpolate the velocity along a path, linearly in time, depth, latitude and longitude.

        Raises
        ------
        InputError
            A file cannot be read.
        """
        first, times = self.files[0], (path.time - self._instants[0]) / SECOND
        cells = (
            self._time_axis.cells(times),
            first.depth.cells(path.depth),
            first.latitude.cells(path.latitude),
            first.longitude.cells(path.longitude),
        )
        velocity = np.full((len(times), 2), np.nan)
        inside = np.logical_and.reduce([axis.inside for axis in cells])
        if inside.any():
            velocity[inside] = self._interpolate([_only(axis, inside) for axis in cells])
        return Samples(velocity, _coverage(cells, velocity))

    @property
    def daily_at_midnight(self) -> bool:
        """Return whether the fields are days apart, each labelled 00:00."""
        instants = self._instants
        return bool(len(instants) > 1 and (instants == instants.astype("datetime64[D]")).all())

    @cached_property
    def _order(self) -> list[tuple[ModelFile, int]]:
        """File, and index in it, of every time, in order; if several files have the same time, the first is used."""
        all_times = np.concatenate([file.time for file in self.files])
        places = [(file, index) for file in self.files for index in range(len(file.time))]
        return [places[index] for index in np.unique(all_times, return_index=True)[1]]

    @cached_property
    def _instants(self) -> NDArray[np.datetime64]:
        return np.unique(np.concatenate([file.time for file in self.files]))

    @cached_property
    def _time_axis(self) -> Axis:
        seconds = np.asarray((self._instants - self._instants[0]) / SECOND, dtype=np.float64)
        return Axis(seconds, HOLE * float(np.median(np.diff(seconds))) if len(seconds) > 1 else np.inf)

    def _interpolate(self, cells: Sequence[Cells]) -> Array:
        """Interpolate multilinearly ``(n, 2)`` from one box that contains all neighbours."""
        spans = [_spans(axis, wraps=index == 3) for index, axis in enumerate(cells)]
        box = self._read(spans)
        corners = [
            ((_place(axis.lower, span), 1.0 - axis.weight), (_place(axis.upper, span), axis.weight))
            for axis, span in zip(cells, spans, strict=True)
        ]
        total = np.zeros((len(cells[0].weight), 2))
        for number in range(2 ** len(corners)):
            chosen = [corner[number >> axis & 1] for axis, corner in enumerate(corners)]
            weight = np.prod([share for _, share in chosen], axis=0)[:, None]
            # A neighbour of weight zero is ignored, even if it is land (NaN).
            total += np.where(weight > 0.0, weight * box[tuple(offset for offset, _ in chosen)], 0.0)
        return total

    def _read(self, spans: Sequence[Sequence[slice]]) -> Array:
        (times,), (depths,), (latitudes,), longitudes = spans
        strips = [
            np.concatenate([file.read(when, depths, latitudes, along) for file, when in self._slabs(times)])
            for along in longitudes
        ]
        return np.concatenate(strips, axis=3)

    def _slabs(self, times: slice) -> Iterator[tuple[ModelFile, slice]]:
        """Yield the files and the slices of their times that make up a slice of all times."""
        slab = self._order[times]
        breaks = [
            index
            for index, (before, after) in enumerate(pairwise(slab), 1)
            if after[0] is not before[0] or after[1] != before[1] + 1
        ]
        for begin, end in pairwise([0, *breaks, len(slab)]):
            file, index = slab[begin]
            yield file, slice(index, index + end - begin)


@dataclass(frozen=True, eq=False)
class OceanModel:
    """A model: its name, and its grids (several if its files cover different regions).

    Attributes
    ----------
    name : str
        Name of the product.
    grids : sequence of Grid
        Grids in order of appearance.
    """

    name: str
    grids: Sequence[Grid]

    @property
    def labels(self) -> list[str]:
        """Labels of the model's files, as used in messages."""
        return [file.label for grid in self.grids for file in grid.files]

    @property
    def daily_at_midnight(self) -> bool:
        """Return whether the fields are days apart and labelled 00:00; they may be means of the following day."""
        return all(grid.daily_at_midnight for grid in self.grids)

    def sample(self, path: DivePath) -> Samples:
        """Interpolate the velocity along a path from the first grid that has one.

        Raises
        ------
        InputError
            A file cannot be read.
        """
        first, *others = (grid.sample(path) for grid in self.grids)
        velocity, coverage = first.velocity, first.coverage
        for other in others:
            better = other.coverage < coverage
            velocity = np.where(better[:, None], other.velocity, velocity)
            coverage = np.where(better, other.coverage, coverage)
        return Samples(velocity, coverage)


@contextmanager
def open_models(sources: Iterable[str]) -> Iterator[tuple[OceanModel, ...]]:
    """Open files and URLs, and combine those of one product into one model, in order of appearance.

    Raises
    ------
    InputError
        A source cannot be opened, or is not an ocean model's.
    """
    with ExitStack() as stack:
        grids: dict[str, list[Grid]] = {}
        for source in sources:
            file = stack.enter_context(open_model_file(source))
            known = grids.setdefault(file.product, [])
            fitting = next((index for index, grid in enumerate(known) if grid.fits(file)), None)
            if fitting is None:
                known.append(Grid([file]))
            else:
                known[fitting] = Grid([*known[fitting].files, file])
        yield tuple(OceanModel(name, tuple(parts)) for name, parts in grids.items())


def expand_source(source: str) -> list[str]:
    """Return the address itself, or the absolute paths of the files with a name or pattern, in order.

    Raises
    ------
    InputError
        There is no such file, or none matches the pattern.
    """
    if is_url(source):
        return [source]
    absolute = Path(source).absolute()
    if absolute.exists():
        return [str(absolute)]
    matches = sorted(Path(absolute.anchor).glob(str(absolute.relative_to(absolute.anchor))))
    if not matches:
        raise InputError(f"{source}: no such file")
    return [str(path) for path in matches]


def _only(cells: Cells, inside: NDArray[np.bool_]) -> Cells:
    return Cells(cells.lower[inside], cells.upper[inside], cells.weight[inside], cells.inside[inside])


def _spans(cells: Cells, wraps: bool) -> list[slice]:
    """Slices that contain all neighbours: one, or two if they lie at both ends of longitudes around the globe."""
    needed = np.unique(np.concatenate([cells.lower, cells.upper]))
    jumps = np.diff(needed)
    if wraps and jumps.size and jumps.max() > 0.5 * (needed[-1] + 1):
        cut = int(jumps.argmax())
        return [slice(int(needed[0]), int(needed[cut]) + 1), slice(int(needed[cut + 1]), int(needed[-1]) + 1)]
    return [slice(int(needed[0]), int(needed[-1]) + 1)]


def _place(indices: NDArray[np.int64], spans: Sequence[slice]) -> NDArray[np.int64]:
    """Convert indices on the axis to indices within the box that the slices were read into."""
    held = np.concatenate([np.arange(span.start, span.stop) for span in spans])
    return np.searchsorted(held, indices)


def _coverage(cells: Sequence[Cells], velocity: Array) -> NDArray[np.int64]:
    """Coverage of each position; a missing velocity has the first reason that applies of box, time, depth and land."""
    time, depth, latitude, longitude = (axis.inside for axis in cells)
    coverage = np.where(np.isfinite(velocity).all(axis=1), Coverage.VELOCITY, Coverage.LAND)
    coverage = np.where(depth, coverage, Coverage.DEPTH)
    coverage = np.where(time, coverage, Coverage.TIME)
    return np.where(latitude & longitude, coverage, Coverage.BOX).astype(np.int64)
