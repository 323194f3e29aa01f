"""Study ``drift``: long-term drift of the disturbances, and what it says of the hull (section 5.6)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.analysis.archived import chosen_profiles, platform_of, positions
from gliderhpc.analysis.comparison import comparisons_as_json
from gliderhpc.analysis.drift.coefficients import SegmentJob, SegmentMedians, reinvert
from gliderhpc.analysis.drift.compared import comparisons
from gliderhpc.analysis.drift.depth_band import DepthBand, depth_band
from gliderhpc.analysis.drift.drag import DragDrift, coefficient_scale, drag_drift, weight_effects
from gliderhpc.analysis.drift.epochs import choose_epochs, epoch_of_profiles
from gliderhpc.analysis.drift.figure_9 import drag_figure, figure_9
from gliderhpc.analysis.drift.medians import DRAG, PHASES, PRIMARY, PRIOR, MedianJob, column, study_profile
from gliderhpc.analysis.drift.series import LONGITUDINAL, EstimateTrends, estimate_trends, trend_of
from gliderhpc.analysis.drift.settings import DriftSettings
from gliderhpc.analysis.drift.spread import CoefficientSlopes, coefficient_slopes
from gliderhpc.analysis.drift.table_5 import table_5, table_5_text
from gliderhpc.analysis.drift.table_6 import table_6, table_6_text
from gliderhpc.analysis.drift.verdict import Verdict, verdict_lines
from gliderhpc.analysis.drift.witness import WITNESS, Witness, forward_errors, witness_of
from gliderhpc.analysis.files import as_plain
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.study import Request, StudiedProfile, Study, archive_findings, begin_study, own_assignments
from gliderhpc.analysis.trend import LEAST
from gliderhpc.errors import InputError
from gliderhpc.mission.archive import open_mission
from gliderhpc.mission.planning import select_profiles
from gliderhpc.mission.profile_data import ADJOINT, SMOOTHED, done_profiles
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.platform import Platform
from gliderhpc.store_schema import finish_study, write_table_rows

NAME = "drift"

_OF_ARCHIVE = ("profile", "elapsed_days")
"""Columns that the archive holds elsewhere."""

QUICK_EPOCHS, QUICK_DRAWS = 4, 10
"""What a first look takes."""


@dataclass(frozen=True, eq=False)
class Mission:
    """What the study reads of an archive before it starts: profiles in epochs, the band, and the hull."""

    epochs: list[tuple[int, ...]]
    where: dict[int, int]
    days: dict[int, float]
    band: DepthBand
    smoothed: bool
    hull: Platform
    title: str
    witness: list[float] | None

    @property
    def numbers(self) -> list[int]:
        """Profiles of all epochs."""
        return [number for epoch in self.epochs for number in epoch]


@dataclass(frozen=True, eq=False)
class DriftFindings:
    """What is found in a table of medians."""

    trends: list[EstimateTrends]
    drags: list[DragDrift]
    slopes: list[CoefficientSlopes]
    witness: Witness | None

    @property
    def verdict(self) -> Verdict:
        """What the primary estimates say together."""
        return Verdict(tuple(drag for drag in self.drags if drag.estimate in PRIMARY))


def missing_input(request: Request) -> str | None:
    """Say what is lacking: profiles enough for a trend."""
    with open_mission(request.archive) as archive:
        done = done_profiles(archive)
    count = len(select_profiles(done, request.profiles)) if done else 0
    return None if count >= LEAST else f"a trend takes {LEAST} finished profiles or more, and these are {count}"


def run(request: Request) -> Findings:
    """Study the epochs of a mission, into the archive's group ``drift``.

    Raises
    ------
    InputError
        Fewer than four profiles have medians, or a setting is wrong.
    """
    settings = _settings(request)
    studied = study_mission(request, settings)
    remarks = begin_study(request, NAME)
    if request.estimate != ADJOINT:
        remarks += ("all estimates stand side by side in this study, so --estimate changes nothing",)
    write_table_rows(request.archive, _stored(studied), NAME)
    return _conclude(request, studied, settings, remarks)


@dataclass(frozen=True, eq=False)
class Studied:
    """A mission studied: its table of medians, what its segments gave, and what is found in both."""

    mission: Mission
    table: pd.DataFrame
    segments: list[SegmentMedians]
    found: DriftFindings


def study_mission(request: Request, settings: DriftSettings) -> Studied:
    """Take the medians of a mission's epochs, draw coefficients, and find what drifts; nothing is written.

    Raises
    ------
    InputError
        Fewer than four profiles have medians.
    """
    with open_mission(request.archive) as archive:
        mission = _mission(archive, request, settings)
    rows, segments = _profiles(request, mission, settings)
    table = _table(mission, rows)
    return Studied(mission, table, segments, find_drift(table, mission.hull, settings, segments))


def find_drift(
    table: pd.DataFrame, hull: Platform, settings: DriftSettings, segments: Sequence[SegmentMedians] = ()
) -> DriftFindings:
    """Find trends, drag and their meaning in a table of medians.

    Parameters
    ----------
    table : pandas.DataFrame
        A row a profile: ``profile``, ``elapsed_days``, ``epoch`` and what `profile_row` gives.
    hull : Platform
        The mission's.
    settings : DriftSettings
        How.
    segments : sequence of SegmentMedians
        Of the same profiles, where coefficients were drawn.
    """
    estimates = [name for name in (PRIOR, *PRIMARY) if column(DRAG, "dive", name) in table]
    slopes = coefficient_slopes(table, segments) if segments else []
    scale = coefficient_scale(slopes, weight_effects(table)) if segments else (1.0, 1.0)
    return DriftFindings(
        [estimate_trends(table, name, settings.resamples, settings.seed) for name in estimates],
        [drag_drift(table, name, hull, scale, settings.resamples, settings.seed) for name in estimates],
        slopes,
        witness_of(table, settings.resamples, settings.seed),
    )


def _settings(request: Request) -> DriftSettings:
    settings = build_settings_of(DriftSettings, {}, own_assignments(request, NAME))
    if not request.quick:
        return settings
    coefficients = settings.coefficients
    few = coefficients.model_copy(update={"draws": min(coefficients.draws, QUICK_DRAWS)})
    epochs = QUICK_EPOCHS if settings.epochs is None else min(settings.epochs, QUICK_EPOCHS)
    return settings.model_copy(update={"epochs": epochs, "coefficients": few})


def _mission(archive: xr.DataTree, request: Request, settings: DriftSettings) -> Mission:
    numbers = list(chosen_profiles(archive, request.profiles))
    epochs = choose_epochs(numbers, settings.epochs, settings.epoch_size)
    chosen = [number for epoch in epochs for number in epoch]
    table = archive.to_dataset().sel(profile=chosen)
    return Mission(
        epochs, positions(archive), dict(zip(chosen, table["elapsed_days"].values.tolist(), strict=True)),
        depth_band(table["max_depth"].values, settings.depth_band), SMOOTHED in archive.children,
        platform_of(archive), str(archive.attrs.get("mission") or "mission"),
        forward_errors(archive, chosen),
    )  # fmt: skip


def _profiles(
    request: Request, mission: Mission, settings: DriftSettings
) -> tuple[list[StudiedProfile], list[SegmentMedians]]:
    """Take the medians, and invert the segments anew; in the order of the profiles."""
    path, drawn = str(request.archive.resolve()), settings.coefficients
    medians = [
        MedianJob(number, mission.where[number], path, mission.band, mission.smoothed) for number in mission.numbers
    ]
    again = [SegmentJob(number, path, mission.band, drawn, settings.seed) for number in mission.numbers]
    segments = []
    with request.executor() as opened:
        rows = sorted(opened.run(study_profile, medians), key=lambda row: row.number)
        for one in opened.run(reinvert, again) if drawn.draws else ():
            segments.append(one)
            request.report(one.number)
    return rows, sorted(segments, key=lambda one: one.number)


def _table(mission: Mission, rows: Sequence[StudiedProfile]) -> pd.DataFrame:
    epoch = dict(zip(mission.numbers, epoch_of_profiles(mission.epochs).tolist(), strict=True))
    table = pd.DataFrame(
        [
            {"profile": row.number, "elapsed_days": mission.days[row.number], "epoch": epoch[row.number], **row.row}
            for row in rows
        ]
    )
    if mission.witness is not None:
        table[WITNESS] = mission.witness
    names = [column(DRAG, phase, ADJOINT) for phase in PHASES]
    known = [np.isfinite(table[name]).sum() if name in table else 0 for name in names]
    if min(known) < LEAST:
        raise InputError(
            f"{NAME}: only {known[0]} dives and {known[1]} climbs have {LEAST} or more medians between "
            f"{mission.band.low:.0f} and {mission.band.high:.0f} m; give --set drift.depth_band=[LOW,HIGH]"
        )
    return table


def _stored(studied: Studied) -> dict[int, dict[str, Any]]:
    """Rows of the archive's table by position, without what is missing."""
    return {
        studied.mission.where[row["profile"]]: {
            str(name): value for name, value in row.items() if name not in _OF_ARCHIVE and not pd.isna(value)
        }
        for row in studied.table.to_dict("records")
    }


def _conclude(request: Request, studied: Studied, settings: DriftSettings, remarks: tuple[str, ...]) -> Findings:
    """Put the tables, the figures and the facts together, and close the group."""
    mission, found, increase = studied.mission, studied.found, settings.drag_increase
    rows_5 = table_5(found.trends)
    rows_6 = table_6(found.slopes, _whole(studied.table, settings)) if studied.segments else []
    rows = comparisons(found.trends, found.verdict, found.slopes, found.witness, increase)
    primary = [own for own in found.trends if own.estimate in PRIMARY]
    facts = {
        "profiles": mission.numbers,
        "epochs": mission.epochs,
        "depth_band": (mission.band.low, mission.band.high),
        "quick": request.quick,
        "settings": settings.model_dump(),
        "verdict": found.verdict.as_json(increase),
        "segments": sum(one.segments for one in studied.segments),
        "table_5": rows_5,
        "table_6": rows_6,
    }
    finish_study(request.archive, NAME, as_plain({**facts, "comparisons": comparisons_as_json(rows)}))
    said = (*remarks, *_inputs(studied), *verdict_lines(found.verdict, primary, increase))
    tables = {"medians": studied.table, "table_5": pd.DataFrame(rows_5)}
    if rows_6:
        tables["table_6"] = pd.DataFrame(rows_6)
    figures = {
        "figure_9": figure_9(mission.title, studied.table, primary),
        "drag": drag_figure(mission.title, studied.table, found.verdict.drags),
    }
    findings = archive_findings(NAME, rows, tables, figures, facts, _failed(studied.table), said)
    documents = {
        "table_5.md": table_5_text(rows_5),
        "table_6.md": table_6_text(rows_6, settings.coefficients, found.witness),
    }
    return replace(findings, documents=documents)


def _whole(table: pd.DataFrame, settings: DriftSettings) -> dict[tuple[str, str], float]:
    """The adjoint's slopes over all samples that count, which the segments stand for."""
    return {
        (quantity, phase): trend_of(
            table, column(quantity, phase, ADJOINT), settings.resamples, settings.seed
        ).trend.slope
        for quantity in (*LONGITUDINAL, DRAG)
        for phase in PHASES
    }


def _inputs(studied: Studied) -> tuple[str, ...]:
    """Say what the study was made from, and what was not there."""
    found, band = studied.found, studied.mission.band
    remarks = [band.remark] if band.remark else []
    if found.witness is None:
        remarks.append("no second witness: run `gliderhpc validate` on the archive first for the forward model's error")
    if not studied.segments:
        remarks.append(
            "no coefficients drawn: the intervals hold the scatter of the profiles and an unknown heave alone"
        )
    if len(found.verdict.drags) < len(PRIMARY):
        remarks.append("the archive holds no smoothed estimate: the verdict is the adjoint's alone")
    return tuple(remarks)


def _failed(table: pd.DataFrame) -> dict[int, str]:
    if "message" not in table:
        return {}
    said = table[["profile", "message"]].itertuples(index=False)
    return {int(number): text for number, text in said if isinstance(text, str)}


STUDY = Study(NAME, "long-term drift: is the hull fouling, since when, how much, how sure", missing_input, run)
"""What the registry finds."""
