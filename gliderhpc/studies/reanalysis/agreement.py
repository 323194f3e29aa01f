"""Agreement of currents over a mission: the glider's with the models', and the models' with one another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.findings.comparison import Comparison, Paper
from gliderhpc.studies.library.currents import Current, archived_currents
from gliderhpc.studies.library.scores import speed, turn, vector_rmsd

Array = NDArray[np.float64]

PANELS = 9
"""Profiles of Table 4 and Figure 8."""


@dataclass(frozen=True, eq=False)
class Compared:
    """Depth-averaged currents, north and east in m/s, NaN where there is none.

    Attributes
    ----------
    numbers : (n,) int array
        Of the profiles.
    days : (n,) array
        Since the mission's first observation.
    estimate : str
        Whose self-motion `currents` rest on.
    currents : sequence of Current
        The glider's, with covariance.
    glide_angle : (n, 2) array
        The conventional estimate.
    names : tuple of str
        Of the models.
    models : (n, m, 2) array
    distance : (n, m) array
        Of each model from the glider's current, standard deviations.
    """

    numbers: NDArray[np.int64]
    days: Array
    estimate: str
    currents: Sequence[Current]
    glide_angle: Array
    names: tuple[str, ...]
    models: Array
    distance: Array

    @property
    def glider(self) -> Array:
        """The glider's currents ``(n, 2)``."""
        return np.array([current.velocity for current in self.currents]).reshape(-1, 2)

    def panels(self) -> list[int]:
        """Places of up to nine profiles, evenly spread over those that a model covers, else over those with a current.

        Empty where no profile has a current.
        """
        known = np.isfinite(self.glider).all(axis=1)
        covered = known & np.isfinite(self.models.sum(axis=2)).any(axis=1)
        places = np.flatnonzero(covered if covered.any() else known)
        if not places.size:
            return []
        even = np.linspace(0.0, places.size - 1.0, min(PANELS, places.size))
        return [int(place) for place in places[np.round(even).astype(np.int64)]]


def compare(archive: xr.DataTree, numbers: Sequence[int], estimate: str) -> Compared:
    """Read the models' currents of some profiles, with the glider's own."""
    group = archive["reanalysis"].to_dataset().sel(profile=list(numbers)).load()
    table = archive.to_dataset().sel(profile=list(numbers)).load()
    return Compared(
        numbers=np.array(numbers, dtype=np.int64),
        days=np.asarray(table["elapsed_days"].values, dtype=np.float64),
        estimate=estimate,
        currents=archived_currents(archive, numbers, estimate),
        glide_angle=np.column_stack([table[f"dac_{along}_glide_angle"].values for along in ("north", "east")]),
        names=tuple(str(name) for name in group["model"].values),
        models=np.stack([group["north"].values, group["east"].values], axis=-1),
        distance=np.asarray(group["distance"].values),
    )


GLIDER, GLIDE_ANGLE = "glider", "glide angle"

WITHIN: dict[tuple[str, int], Paper] = {
    ("HYCOM", 2): 5 / 9, ("HYCOM", 3): 6 / 9, ("GLORYS12", 2): 2 / 9, ("GLORYS12", 3): 6 / 9,
}  # fmt: skip
"""Share of the paper's nine profiles on which a model lies within so many sigma."""

MUTUAL_RMSD = 0.11
"""Vector RMSD (m/s) of the paper's two models from each other."""

GLIDE_ANGLE_DIRECTION = 8.0
"""Median difference (degree) of the paper's adjoint and glide-angle directions."""

GAUSSIAN = {1: 0.393, 2: 0.865, 3: 0.989}
"""Share of a Gaussian in the plane within so many sigma."""


@dataclass(frozen=True)
class Agreement:
    """Differences of one current from another over the profiles that have both.

    Attributes
    ----------
    of, against : str
        Which they are; the differences are of the first less the second.
    profiles : int
        That have both.
    vector_rmsd : float
        Root mean square length of the difference, m/s.
    north, east : float
        Mean difference, m/s.
    speed : float
        Mean difference of the speeds, m/s.
    direction : float
        Circular mean of the differences in direction, degree.
    direction_median, direction_least, direction_most : float
        Median and range of their magnitudes, degree.
    """

    of: str
    against: str
    profiles: int
    vector_rmsd: float
    north: float
    east: float
    speed: float
    direction: float
    direction_median: float
    direction_least: float
    direction_most: float


def agreement(of: str, velocity: Array, against: str, reference: Array) -> Agreement:
    """Summarise how velocities ``(n, 2)`` differ from others; NaN throughout where no profile has both."""
    known = np.isfinite(velocity).all(axis=1) & np.isfinite(reference).all(axis=1)
    if not known.any():
        return Agreement(of, against, 0, *[float("nan")] * 8)
    ours, theirs = velocity[known], reference[known]
    turns = turn(ours, theirs)
    around = np.exp(1j * np.radians(turns)).mean()
    north, east = (ours - theirs).mean(axis=0)
    sizes = np.abs(turns)
    return Agreement(
        of, against, int(known.sum()), vector_rmsd(ours, theirs), float(north), float(east),
        float((speed(ours) - speed(theirs)).mean()), float(np.degrees(np.angle(around))),
        float(np.median(sizes)), float(sizes.min()), float(sizes.max()),
    )  # fmt: skip


def agreements(compared: Compared) -> list[Agreement]:
    """Every model and the glide angle against the glider, then the models against one another, pair by pair."""
    with_models = {name: compared.models[:, index] for index, name in enumerate(compared.names)}
    against_glider = {GLIDE_ANGLE: compared.glide_angle, **with_models}
    return [
        *(agreement(name, velocity, GLIDER, compared.glider) for name, velocity in against_glider.items()),
        *(agreement(b, with_models[b], a, with_models[a]) for a, b in combinations(compared.names, 2)),
    ]


def share_within(distance: Array, sigmas: int) -> float:
    """Share of the known distances ``(n,)`` that are no greater; NaN without any."""
    known = distance[np.isfinite(distance)]
    return float((known <= sigmas).mean()) if known.size else float("nan")


def agreement_rows(compared: Compared, found: list[Agreement]) -> list[dict[str, Any]]:
    """Rows of the table of agreements, those against the glider with the shares within 1, 2 and 3 sigma."""
    return [{**asdict(one), **_shares(compared, one)} for one in found]


def comparisons(compared: Compared, found: list[Agreement]) -> tuple[Comparison, ...]:
    """The agreements and the distances, compared with section 5.5."""
    return (
        *(row for one in found for row in _of_agreement(one)),
        *(row for index in range(len(compared.names)) for row in _of_distance(compared, index)),
    )


def _shares(compared: Compared, one: Agreement) -> dict[str, float]:
    if one.against != GLIDER or one.of not in compared.names:
        return {}
    distance = compared.distance[:, compared.names.index(one.of)]
    return {f"within_{sigmas}_sigma": share_within(distance, sigmas) for sigmas in GAUSSIAN}


def _of_agreement(one: Agreement) -> Iterator[Comparison]:
    pair, count = f"{one.of} against {one.against}", f"{one.profiles} profiles"
    published = {one.of, one.against} == {"HYCOM", "GLORYS12"}
    yield Comparison(f"vector RMSD, {pair}", "m/s", one.vector_rmsd, MUTUAL_RMSD if published else None, remark=count)
    yield Comparison(f"mean speed difference, {pair}", "m/s", one.speed, remark=count)
    yield Comparison(
        f"direction difference, {pair}", "degree", one.direction_median,
        GLIDE_ANGLE_DIRECTION if one.of == GLIDE_ANGLE else None,
        spread=(one.direction_least, one.direction_most),
        paper_said="0.2 to 127" if published else "",
        remark=f"median and range of the magnitude; {count}",
    )  # fmt: skip


def _of_distance(compared: Compared, index: int) -> Iterator[Comparison]:
    name, distance = compared.names[index], compared.distance[:, index]
    known = distance[np.isfinite(distance)]
    median = float(np.median(known)) if known.size else float("nan")
    spread = (float(known.min()), float(known.max())) if known.size else None
    yield Comparison(f"distance of {name}", "sigma", median, spread=spread, remark="median and range")
    for sigmas, gaussian in GAUSSIAN.items():
        yield Comparison(
            f"share of profiles with {name} within {sigmas} sigma", "1", share_within(distance, sigmas),
            WITHIN.get((name, sigmas)), remark=f"{known.size} profiles; {gaussian:g} if the ellipse were all there is",
        )  # fmt: skip
