"""Study ``drift``: long-term drift of the disturbances, and its consequences for the hull (section 5.6).

The study determines whether the hull is fouling, since when, and with what certainty. Every profile gives medians;
profiles in epochs also give the medians of segments that are inverted again with randomly drawn hulls. Trends, change
points and the verdict are determined over the mission.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import ADJOINT, SMOOTHED, ProfileData, done_profiles, read_profile_data
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError
from gliderhpc.observations.profile_numbers import select_profiles
from gliderhpc.platform import Platform
from gliderhpc.store_schema.columns import CHANGE, FORWARD_ERROR_COLUMN, MOMENT_CHANGE, median_column
from gliderhpc.studies.archived import chosen_profiles, outdated_input_remarks, platform_of, settings_of, windows_start
from gliderhpc.studies.library.drift.change_points import find_changes, find_moment_changes
from gliderhpc.studies.library.drift.change_rows import stored_changes, stored_moment_changes
from gliderhpc.studies.library.drift.changes import Changes
from gliderhpc.studies.library.drift.coefficients import (
    CoefficientSlopes,
    SegmentMedians,
    coefficient_slopes,
    segment_medians,
    slope_labels,
    stored_slopes,
)
from gliderhpc.studies.library.drift.medians import (
    DRAG,
    DepthBand,
    DriftSettings,
    counted_estimates,
    depth_band,
    profile_row,
)
from gliderhpc.studies.library.drift.series import choose_epochs, epoch_of_profiles, of_epochs, values_of
from gliderhpc.studies.library.drift.verdict import VALIDATION_GROUP, DriftFindings, find_drift, forward_errors
from gliderhpc.studies.library.trends import MIN_VALUES
from gliderhpc.studies.request import Request, study_settings
from gliderhpc.studies.study import GroupContent, Plan, Preparation, ProfileContext, Row, Study
from gliderhpc.vocabulary import PHASES

NAME = "drift"

QUICK_EPOCHS, QUICK_DRAWS = 4, 10
"""Numbers of epochs and draws of a first look."""


# Before the profiles


@dataclass(frozen=True, eq=False)
class DriftInputs:
    """Inputs read from an archive before the study starts: profiles, epochs, depth band, hull."""

    numbers: list[int]
    epochs: list[tuple[int, ...]]
    epoch: dict[int, int]
    days: dict[int, float]
    band: DepthBand
    smoothed: bool
    windows_start: str
    hull: Platform
    forward_errors: dict[int, float] | None


def prepare(request: Request, archive: Archive, numbers: tuple[int, ...], settings: DriftSettings) -> Preparation:
    """Choose epochs and depth band; profiles outside the epochs are used only in the search for change points."""
    every = list(chosen_profiles(archive, request.profiles))
    epochs = choose_epochs(every, settings.epochs, settings.epoch_size)
    in_epochs = [number for epoch in epochs for number in epoch]
    chosen = every if settings.changes.most else in_epochs
    table = archive.to_dataset()
    mission = DriftInputs(
        numbers=chosen,
        epochs=epochs,
        epoch=dict(zip(in_epochs, epoch_of_profiles(epochs).tolist(), strict=True)),
        days=dict(zip(chosen, table["elapsed_days"].sel(profile=chosen).values.tolist(), strict=True)),
        band=depth_band(table["max_depth"].sel(profile=in_epochs).values, settings.depth_band),
        smoothed=SMOOTHED in archive.children,
        windows_start=windows_start(archive),
        hull=platform_of(archive),
        forward_errors=forward_errors(archive, chosen),
    )
    outdated = () if mission.forward_errors is None else outdated_input_remarks(archive, VALIDATION_GROUP)
    return Preparation(inputs=mission, numbers=tuple(chosen), remarks=outdated)


# One profile


def study_profile(data: ProfileData, context: ProfileContext) -> Row:
    """Compute the medians of one profile and, if it is in an epoch, of its ``segments`` inverted with drawn hulls."""
    mission: DriftInputs = context.inputs
    settings: DriftSettings = context.settings
    smoothed = read_profile_data(context.archive, data.number, SMOOTHED) if mission.smoothed else None
    row = profile_row(data, smoothed, mission.band, mission.hull)
    if mission.forward_errors is not None:
        row[FORWARD_ERROR_COLUMN] = mission.forward_errors[data.number]
    if data.number not in mission.epoch:
        return row
    row["epoch"] = mission.epoch[data.number]
    drawn = settings.coefficients
    if drawn.draws:
        row["segments"] = segment_medians(
            data, mission.hull, settings_of(context.archive), mission.band, drawn, settings.seed
        )
    return row


# The mission


@dataclass(frozen=True, eq=False)
class MissionDrift:
    """A mission's table of medians, its slopes under drawn coefficients, the number of segments, and the settings."""

    mission: DriftInputs
    table: pd.DataFrame
    slopes: list[CoefficientSlopes]
    segments: int
    settings: DriftSettings

    @cached_property
    def changes(self) -> Changes:
        """Change points of drag and axial force."""
        settings = self.settings
        return find_changes(self.table, self.mission.hull.viscous.K_D0, settings.changes, settings.seed)

    @cached_property
    def moments(self) -> Changes:
        """Change points of the moments."""
        settings = self.settings
        return find_moment_changes(self.table, self.mission.hull, settings.changes, settings.seed)

    @cached_property
    def found(self) -> DriftFindings:
        """Trends, drag and verdict."""
        counted = counted_estimates(self.mission.windows_start)
        return find_drift(
            self.table,
            self.mission.hull,
            self.settings,
            self.slopes,
            changes=self.changes,
            counted=counted,
            moments=self.moments,
        )


def drift_of_rows(plan: Plan, rows: Mapping[int, Row]) -> MissionDrift:
    """Return the drift of a mission from the rows of its profiles.

    Raises
    ------
    InputError
        Fewer than four profiles have medians.
    """
    mission: DriftInputs = plan.prepared.inputs
    table = _table(mission, rows)
    segments: list[SegmentMedians] = [row["segments"] for row in rows.values() if "segments" in row]
    slopes = coefficient_slopes(of_epochs(table), segments) if segments else []
    return MissionDrift(mission, table, slopes, sum(medians.segments for medians in segments), plan.settings)


def _table(mission: DriftInputs, rows: Mapping[int, Row]) -> pd.DataFrame:
    """Return the table of medians, with a row for each profile."""
    table = pd.DataFrame(
        [
            {"profile": number, "elapsed_days": mission.days[number], "epoch": np.nan, **row}
            for number, row in rows.items()
        ]
    ).drop(columns="segments", errors="ignore")
    if mission.forward_errors is not None:
        table[FORWARD_ERROR_COLUMN] = table.pop(FORWARD_ERROR_COLUMN)
    names = [median_column(DRAG, phase, ADJOINT) for phase in PHASES]
    known = [np.isfinite(values_of(of_epochs(table), name)).sum() for name in names]
    if min(known) < MIN_VALUES:
        one_leg = any(known) and not all(known)
        remedy = "the study needs records of both legs" if one_leg else "give `drift.depth_band=[LOW,HIGH]`"
        raise InputError(
            f"{NAME}: only {known[0]} dives and {known[1]} climbs have a median between {mission.band.low:.0f} and "
            f"{mission.band.high:.0f} m, and {MIN_VALUES} of each are needed; {remedy}"
        )
    return table


def mission_drift(plan: Plan, rows: Mapping[int, Row]) -> GroupContent:
    """Find change points and slopes under drawn coefficients.

    Raises
    ------
    InputError
        Fewer than four profiles have medians.
    """
    studied = drift_of_rows(plan, rows)
    changes, moments, band = studied.changes, studied.moments, studied.mission.band
    return GroupContent(
        sizes={CHANGE: max(1, len(changes.found)), MOMENT_CHANGE: max(1, len(moments.found))},
        labels=slope_labels(studied.slopes),
        variables={**stored_slopes(studied.slopes), **stored_changes(changes), **stored_moment_changes(moments)},
        attributes={
            "depth_band": (band.low, band.high),
            "segments": studied.segments,
            "p_of_next_change": changes.p,
            "next_change": changes.next,
            "p_of_next_moment_change": moments.p,
            "next_moment_change": moments.next,
        },
        remarks=(band.remark,) if band.remark else (),
        columns=tuple(map(str, studied.table)),
    )


def missing_input(request: Request, _: object) -> str | None:
    """Require enough profiles for a trend."""
    with open_for_reading(request.archive) as archive:
        done = done_profiles(archive)
    count = len(select_profiles(done, request.profiles)) if done else 0
    if count >= MIN_VALUES:
        return None
    return f"a trend needs at least {MIN_VALUES} finished profiles, and there are {count}"


def drift_settings(request: Request) -> DriftSettings:
    """Return the requested settings; a first look uses few epochs and draws, and does not search for change points."""
    settings = study_settings(request, NAME, DriftSettings)
    if not request.quick:
        return settings
    coefficients = settings.coefficients
    few = coefficients.model_copy(update={"draws": min(coefficients.draws, QUICK_DRAWS)})
    epochs = QUICK_EPOCHS if settings.epochs is None else min(settings.epochs, QUICK_EPOCHS)
    none = settings.changes.model_copy(update={"most": 0})
    return settings.model_copy(update={"epochs": epochs, "coefficients": few, "changes": none})


STUDY = Study(
    NAME,
    "long-term drift: whether the hull is fouling, since when, by how much, and with what certainty",
    profile=study_profile,
    mission=mission_drift,
    settings=drift_settings,
    missing=missing_input,
    prepare=prepare,
    estimate_unused="this study uses all estimates; `estimate` has no effect",
)
