"""Comparison of the glider's currents with ocean models, and with section 5.5 of the paper (Table 4, Figure 8)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.archive.reader import Archive
from gliderhpc.findings.comparison import Comparison, Paper
from gliderhpc.studies.library.scores import (
    COVERAGE,
    direction_difference,
    speed,
    vector_rmsd,
)
from gliderhpc.studies.library.tracks import (
    BY_GLIDE_ANGLE,
    UncertainCurrent,
    archived_currents,
)
from gliderhpc.wording import counted

Array = NDArray[np.float64]

PANELS = 9
"""Profiles of Table 4 and Figure 8."""

GLIDER, GLIDE_ANGLE = "glider", "glide angle"

WITHIN: dict[tuple[str, int], Paper] = {
    ("HYCOM", 2): 5 / 9,
    ("HYCOM", 3): 6 / 9,
    ("GLORYS12", 2): 2 / 9,
    ("GLORYS12", 3): 6 / 9,
}
"""Share of the paper's nine profiles for which a model is within the given number of sigma."""

MUTUAL_RMSD = 0.11
"""Vector RMSD (m/s) of the paper's two models from each other."""

GLIDE_ANGLE_DIRECTION = 8.0
"""Median difference (degree) of the paper's adjoint and glide-angle directions."""

GAUSSIAN = COVERAGE | {3: 0.989}
"""Share of a two-dimensional Gaussian within the given number of sigma."""

WITHIN_COLUMNS = {1: "within_1_sigma", 2: "within_2_sigma", 3: "within_3_sigma"}
"""Columns of the shares of profiles within 1, 2 and 3 sigma."""


@dataclass(frozen=True, eq=False)
class Compared:
    """Depth-averaged currents, north and east in m/s; NaN where there is no current.

    Attributes
    ----------
    numbers : (n,) int array
        Profile numbers.
    days : (n,) array
        Days since the mission's first observation.
    estimate : str
        Estimate whose self-motion gives `currents`.
    currents : sequence of Current
        Glider's currents, with covariances.
    glide_angle : (n, 2) array
        Glider's currents by the conventional estimate.
    names : tuple of str
        Names of the models.
    models : (n, m, 2) array
        Currents of the models.
    distance : (n, m) array
        Distance of each model from the glider's current, in standard deviations.
    """

    numbers: NDArray[np.int64]
    days: Array
    estimate: str
    currents: Sequence[UncertainCurrent]
    glide_angle: Array
    names: tuple[str, ...]
    models: Array
    distance: Array

    @property
    def glider(self) -> Array:
        """Currents of the glider ``(n, 2)``."""
        return np.array([current.velocity for current in self.currents]).reshape(-1, 2)

    def panels(self) -> list[int]:
        """Positions of up to nine profiles with a current, spread evenly over those that a model covers.

        If no model covers any profile, they are spread over all profiles with a current. Empty without a current.
        """
        known = np.isfinite(self.glider).all(axis=1)
        covered = known & np.isfinite(self.models.sum(axis=2)).any(axis=1)
        places = np.flatnonzero(covered if covered.any() else known)
        if not places.size:
            return []
        even = np.linspace(0.0, places.size - 1.0, min(PANELS, places.size))
        return [int(position) for position in places[np.round(even).astype(np.int64)]]


def compare(archive: Archive, numbers: Sequence[int], estimate: str) -> Compared:
    """Read the models' and the glider's currents of some profiles."""
    group = archive["reanalysis"].to_dataset().sel(profile=list(numbers)).load()
    table = archive.to_dataset().sel(profile=list(numbers)).load()
    return Compared(
        numbers=np.array(numbers, dtype=np.int64),
        days=np.asarray(table["elapsed_days"].values, dtype=np.float64),
        estimate=estimate,
        currents=archived_currents(archive, numbers, estimate),
        glide_angle=np.column_stack([table[name].values for name in BY_GLIDE_ANGLE]),
        names=tuple(str(name) for name in group["model"].values),
        models=np.stack([group["north"].values, group["east"].values], axis=-1),
        distance=np.asarray(group["distance"].values),
    )


@dataclass(frozen=True)
class Agreement:
    """Differences of one current from another over the profiles that have both.

    Attributes
    ----------
    of, against : str
        Names of the two; the differences are the first minus the second.
    profiles : int
        Number of profiles that have both.
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
    """Summarise the differences of velocities ``(n, 2)`` from others; all NaN if no profile has both."""
    known = np.isfinite(velocity).all(axis=1) & np.isfinite(reference).all(axis=1)
    if not known.any():
        return Agreement(of, against, 0, *[float("nan")] * 8)
    ours, theirs = velocity[known], reference[known]
    turns = direction_difference(ours, theirs)
    around = np.exp(1j * np.radians(turns)).mean()
    north, east = (ours - theirs).mean(axis=0)
    sizes = np.abs(turns)
    return Agreement(
        of,
        against,
        profiles=int(known.sum()),
        vector_rmsd=vector_rmsd(ours, theirs),
        north=float(north),
        east=float(east),
        speed=float((speed(ours) - speed(theirs)).mean()),
        direction=float(np.degrees(np.angle(around))),
        direction_median=float(np.median(sizes)),
        direction_least=float(sizes.min()),
        direction_most=float(sizes.max()),
    )


def agreements(compared: Compared) -> list[Agreement]:
    """Compare every model and the glide angle with the glider, then the models with one another, pair by pair."""
    with_models = {name: compared.models[:, index] for index, name in enumerate(compared.names)}
    against_glider = {GLIDE_ANGLE: compared.glide_angle, **with_models}
    return [
        *(agreement(name, velocity, GLIDER, compared.glider) for name, velocity in against_glider.items()),
        *(agreement(b, with_models[b], a, with_models[a]) for a, b in combinations(compared.names, 2)),
    ]


def share_within(distance: Array, sigmas: int) -> float:
    """Share of the known distances ``(n,)`` that do not exceed a limit; NaN if none is known."""
    known = distance[np.isfinite(distance)]
    return float((known <= sigmas).mean()) if known.size else float("nan")


def agreement_rows(compared: Compared, agreements: list[Agreement]) -> list[dict[str, Any]]:
    """Rows of the table of agreements; a model compared with the glider also has the shares within 1, 2 and 3 sigma."""
    return [{**asdict(difference), **_shares(compared, difference)} for difference in agreements]


def comparisons(compared: Compared, agreements: list[Agreement]) -> tuple[Comparison, ...]:
    """Agreements and distances, compared with section 5.5 of the paper."""
    return (
        *(row for difference in agreements for row in _compare_agreement(difference)),
        *(row for index in range(len(compared.names)) for row in _compare_distance(compared, index)),
    )


def _shares(compared: Compared, difference: Agreement) -> dict[str, float]:
    if difference.against != GLIDER or difference.of not in compared.names:
        return {}
    distance = compared.distance[:, compared.names.index(difference.of)]
    return {name: share_within(distance, sigmas) for sigmas, name in WITHIN_COLUMNS.items()}


def _compare_agreement(difference: Agreement) -> Iterator[Comparison]:
    pair, count = f"{difference.of} against {difference.against}", counted(difference.profiles, "profile")
    published = {difference.of, difference.against} == {"HYCOM", "GLORYS12"}
    rmsd = MUTUAL_RMSD if published else None
    yield Comparison(f"vector RMSD, {pair}", "m/s", difference.vector_rmsd, rmsd, remark=count)
    yield Comparison(f"mean speed difference, {pair}", "m/s", difference.speed, remark=count)
    yield Comparison(
        f"direction difference, {pair}",
        "degree",
        difference.direction_median,
        GLIDE_ANGLE_DIRECTION if difference.of == GLIDE_ANGLE else None,
        spread=(difference.direction_least, difference.direction_most),
        paper_text="0.2 to 127" if published else "",
        remark=f"median and range of the magnitude; {count}",
    )


def _compare_distance(compared: Compared, index: int) -> Iterator[Comparison]:
    name, distance = compared.names[index], compared.distance[:, index]
    known = distance[np.isfinite(distance)]
    median = float(np.median(known)) if known.size else float("nan")
    spread = (float(known.min()), float(known.max())) if known.size else None
    yield Comparison(f"distance of {name}", "sigma", median, spread=spread, remark="median and range")
    for sigmas, gaussian in GAUSSIAN.items():
        yield Comparison(
            f"share of profiles with {name} within {sigmas} sigma",
            "1",
            share_within(distance, sigmas),
            WITHIN.get((name, sigmas)),
            remark=f"{counted(known.size, 'profile')}; {gaussian:g} if the ellipse covered all differences",
        )
