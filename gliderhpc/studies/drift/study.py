"""Study ``drift``: long-term drift of the disturbances, and its consequences for the hull (section 5.6)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import ADJOINT, SMOOTHED, done_profiles
from gliderhpc.errors import InputError
from gliderhpc.mission.planning import select_profiles
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.platform import Platform
from gliderhpc.store_schema import write_table_rows, write_whole
from gliderhpc.store_schema.studies.drift import CHANGE, FORWARD_ERROR_COLUMN, PHASES, median_column
from gliderhpc.studies.archived import chosen_profiles, platform_of, positions
from gliderhpc.studies.drift.change_points import Changes, find_changes
from gliderhpc.studies.drift.change_text import stored_changes
from gliderhpc.studies.drift.coefficients import (
    CoefficientSlopes,
    SegmentJob,
    SegmentMedians,
    coefficient_slopes,
    reinvert,
    slope_labels,
    stored_slopes,
)
from gliderhpc.studies.drift.medians import DRAG, DepthBand, MedianJob, depth_band, profile_medians
from gliderhpc.studies.drift.series import choose_epochs, epoch_of_profiles, of_epochs, values_of
from gliderhpc.studies.drift.settings import DriftSettings
from gliderhpc.studies.drift.verdict import DriftFindings, find_drift, forward_errors
from gliderhpc.studies.library.trends import MIN_VALUES
from gliderhpc.studies.profile_jobs import StudiedProfile
from gliderhpc.studies.provenance import Provenance
from gliderhpc.studies.study import Request, Study, begin_study, finish_study_group, own_assignments

NAME = "drift"


@dataclass(frozen=True, eq=False)
class Mission:
    """Inputs read from an archive before the study starts: profiles, epochs, the depth band, and the hull."""

    numbers: list[int]
    epochs: list[tuple[int, ...]]
    where: dict[int, int]
    days: dict[int, float]
    band: DepthBand
    smoothed: bool
    hull: Platform
    forward_errors: list[float] | None

    @property
    def in_epochs(self) -> list[int]:
        """Profiles of all epochs."""
        return [number for epoch in self.epochs for number in epoch]


@dataclass(frozen=True, eq=False)
class MissionDrift:
    """A mission's table of medians, its slopes under drawn coefficients, the number of segments, and the settings."""

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
        """Trends, drag and verdict."""
        return find_drift(self.table, self.mission.hull, self.settings, self.slopes, self.changes)


def study_mission(request: Request, settings: DriftSettings) -> MissionDrift:
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
    return MissionDrift(mission, table, slopes, sum(one.segments for one in segments), settings)


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
    """Take the medians, and invert the segments again; in the order of the profiles."""
    path, drawn = request.path, settings.coefficients
    medians = [
        MedianJob(number, mission.where[number], path, mission.band, mission.smoothed) for number in mission.numbers
    ]
    again = [SegmentJob(number, path, mission.band, drawn, settings.seed) for number in mission.in_epochs]
    segments = []
    with request.executor() as opened:
        rows = sorted(opened.run(profile_medians, medians), key=lambda row: row.number)
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
    if mission.forward_errors is not None:
        table[FORWARD_ERROR_COLUMN] = mission.forward_errors
    names = [median_column(DRAG, phase, ADJOINT) for phase in PHASES]
    known = [np.isfinite(values_of(of_epochs(table), name)).sum() for name in names]
    if min(known) < MIN_VALUES:
        raise InputError(
            f"{NAME}: only {known[0]} dives and {known[1]} climbs have {MIN_VALUES} or more medians between "
            f"{mission.band.low:.0f} and {mission.band.high:.0f} m; give --set drift.depth_band=[LOW,HIGH]"
        )
    return table


_OF_ARCHIVE = ("profile", "elapsed_days")
"""Columns that the archive holds elsewhere."""

QUICK_EPOCHS, QUICK_DRAWS = 4, 10
"""Epochs and draws of a first look."""


def missing_input(request: Request) -> str | None:
    """Require enough profiles for a trend."""
    with open_for_reading(request.archive) as archive:
        done = done_profiles(archive)
    count = len(select_profiles(done, request.profiles)) if done else 0
    if count >= MIN_VALUES:
        return None
    return f"a trend takes {MIN_VALUES} finished profiles or more, and these are {count}"


def run(request: Request) -> None:
    """Study the epochs of a mission and its change points, into the archive's group ``drift``.

    Raises
    ------
    InputError
        Fewer than four profiles have medians, or a setting is wrong.
    """
    settings = _settings(request)
    studied = study_mission(request, settings)
    changes = studied.changes
    sizes = {CHANGE: max(1, len(changes.found))}
    remarks = begin_study(request, NAME, sizes, labels=slope_labels(studied.slopes))
    if request.estimate != ADJOINT:
        remarks += ("all estimates stand side by side in this study, so --estimate changes nothing",)
    write_table_rows(request.archive, _stored(studied), NAME)
    write_whole(request.archive, NAME, {**stored_slopes(studied.slopes), **stored_changes(changes)})
    band = studied.mission.band
    made = Provenance(
        tuple(studied.mission.numbers), tuple(map(str, studied.table)), request.estimate, request.quick,
        settings.model_dump(mode="json"), (*remarks, band.remark) if band.remark else remarks,
    )  # fmt: skip
    more = {"depth_band": (band.low, band.high), "segments": studied.segments, "p_of_next_change": changes.p}
    finish_study_group(request.archive, NAME, made, more)


def _settings(request: Request) -> DriftSettings:
    settings = build_settings_of(DriftSettings, {}, own_assignments(request, NAME))
    if not request.quick:
        return settings
    coefficients = settings.coefficients
    few = coefficients.model_copy(update={"draws": min(coefficients.draws, QUICK_DRAWS)})
    epochs = QUICK_EPOCHS if settings.epochs is None else min(settings.epochs, QUICK_EPOCHS)
    none = settings.changes.model_copy(update={"most": 0})
    return settings.model_copy(update={"epochs": epochs, "coefficients": few, "changes": none})


def _stored(studied: MissionDrift) -> dict[int, dict[str, Any]]:
    """Rows of the archive's table by position, without what is missing."""
    return {
        studied.mission.where[row["profile"]]: {
            str(name): value for name, value in row.items() if name not in _OF_ARCHIVE and not pd.isna(value)
        }
        for row in studied.table.to_dict("records")
    }


STUDY = Study(NAME, "long-term drift: is the hull fouling, since when, how much, how sure", missing_input, run)
