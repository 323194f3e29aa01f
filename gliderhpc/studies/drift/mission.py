"""A mission's epochs taken through the study's jobs: medians, and what the coefficients leave of slopes."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.archive.opening import open_for_reading
from gliderhpc.archive.profile import ADJOINT, SMOOTHED
from gliderhpc.errors import InputError
from gliderhpc.platform import Platform
from gliderhpc.studies.archived import chosen_profiles, platform_of, positions
from gliderhpc.studies.drift.change_points import Changes, find_changes
from gliderhpc.studies.drift.coefficients import SegmentJob, SegmentMedians, reinvert
from gliderhpc.studies.drift.depth_band import DepthBand, depth_band
from gliderhpc.studies.drift.epochs import choose_epochs, epoch_of_profiles
from gliderhpc.studies.drift.found import DriftFindings, find_drift
from gliderhpc.studies.drift.medians import DRAG, PHASES, MedianJob, column, study_profile
from gliderhpc.studies.drift.series import of_epochs, values_of
from gliderhpc.studies.drift.settings import DriftSettings
from gliderhpc.studies.drift.spread import CoefficientSlopes, coefficient_slopes
from gliderhpc.studies.drift.witness import WITNESS, forward_errors
from gliderhpc.studies.library.trend import LEAST
from gliderhpc.studies.profile_jobs import StudiedProfile
from gliderhpc.studies.study import Request

NAME = "drift"


@dataclass(frozen=True, eq=False)
class Mission:
    """What the study reads of an archive before it starts: profiles, those in epochs, the band, and the hull."""

    numbers: list[int]
    epochs: list[tuple[int, ...]]
    where: dict[int, int]
    days: dict[int, float]
    band: DepthBand
    smoothed: bool
    hull: Platform
    witness: list[float] | None

    @property
    def in_epochs(self) -> list[int]:
        """Profiles of all epochs."""
        return [number for epoch in self.epochs for number in epoch]


@dataclass(frozen=True, eq=False)
class Studied:
    """A mission studied: its table of medians, what its segments gave and how many they were, and how."""

    mission: Mission
    table: pd.DataFrame
    slopes: list[CoefficientSlopes]
    segments: int
    settings: DriftSettings

    @cached_property
    def changes(self) -> Changes:
        """Change points of the mission."""
        settings = self.settings
        return find_changes(self.table, self.mission.hull.viscous.K_D0, settings.changes, settings.seed)

    @cached_property
    def found(self) -> DriftFindings:
        """What drifts."""
        return find_drift(self.table, self.mission.hull, self.settings, self.slopes, self.changes)


def study_mission(request: Request, settings: DriftSettings) -> Studied:
    """Take the medians of a mission's profiles and draw coefficients for its epochs; nothing is written.

    Raises
    ------
    InputError
        Fewer than four profiles have medians.
    """
    with open_for_reading(request.archive) as archive:
        mission = _mission(archive, request, settings)
    rows, segments = _profiles(request, mission, settings)
    table = _table(mission, rows)
    slopes = coefficient_slopes(of_epochs(table), segments) if segments else []
    return Studied(mission, table, slopes, sum(one.segments for one in segments), settings)


def _mission(archive: xr.DataTree, request: Request, settings: DriftSettings) -> Mission:
    numbers = list(chosen_profiles(archive, request.profiles))
    epochs = choose_epochs(numbers, settings.epochs, settings.epoch_size)
    in_epochs = [number for epoch in epochs for number in epoch]
    taken = numbers if settings.changes.most else in_epochs
    table = archive.to_dataset()
    return Mission(
        taken, epochs, positions(archive),
        dict(zip(taken, table["elapsed_days"].sel(profile=taken).values.tolist(), strict=True)),
        depth_band(table["max_depth"].sel(profile=in_epochs).values, settings.depth_band),
        SMOOTHED in archive.children, platform_of(archive), forward_errors(archive, taken),
    )  # fmt: skip


def _profiles(
    request: Request, mission: Mission, settings: DriftSettings
) -> tuple[list[StudiedProfile], list[SegmentMedians]]:
    """Take the medians, and invert the segments anew; in the order of the profiles."""
    path, drawn = request.path, settings.coefficients
    medians = [
        MedianJob(number, mission.where[number], path, mission.band, mission.smoothed) for number in mission.numbers
    ]
    again = [SegmentJob(number, path, mission.band, drawn, settings.seed) for number in mission.in_epochs]
    segments = []
    with request.executor() as opened:
        rows = sorted(opened.run(study_profile, medians), key=lambda row: row.number)
        for one in opened.run(reinvert, again) if drawn.draws else ():
            segments.append(one)
            request.report(one.number)
    return rows, sorted(segments, key=lambda one: one.number)


def _table(mission: Mission, rows: Sequence[StudiedProfile]) -> pd.DataFrame:
    epoch = dict(zip(mission.in_epochs, epoch_of_profiles(mission.epochs).tolist(), strict=True))
    table = pd.DataFrame(
        [
            {
                "profile": row.number,
                "elapsed_days": mission.days[row.number],
                "epoch": epoch.get(row.number, np.nan),
                **row.row,
            }
            for row in rows
        ]
    )
    if mission.witness is not None:
        table[WITNESS] = mission.witness
    names = [column(DRAG, phase, ADJOINT) for phase in PHASES]
    known = [np.isfinite(values_of(of_epochs(table), name)).sum() for name in names]
    if min(known) < LEAST:
        raise InputError(
            f"{NAME}: only {known[0]} dives and {known[1]} climbs have {LEAST} or more medians between "
            f"{mission.band.low:.0f} and {mission.band.high:.0f} m; give --set drift.depth_band=[LOW,HIGH]"
        )
    return table
