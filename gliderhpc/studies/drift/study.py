"""Study ``drift``: long-term drift of the disturbances, and what it says of the hull (section 5.6)."""

from typing import Any

import pandas as pd

from gliderhpc.archive.opening import open_for_reading
from gliderhpc.archive.profile import ADJOINT, done_profiles
from gliderhpc.mission.planning import select_profiles
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.store_schema import write_table_rows, write_whole
from gliderhpc.store_schema.studies.drift import CHANGE
from gliderhpc.studies.drift.change_store import changes_to_keep
from gliderhpc.studies.drift.mission import NAME, Studied, study_mission
from gliderhpc.studies.drift.settings import DriftSettings
from gliderhpc.studies.drift.spread import slope_labels, slopes_to_keep
from gliderhpc.studies.library.trend import LEAST
from gliderhpc.studies.provenance import Provenance
from gliderhpc.studies.study import Request, Study, begin_study, finish_study_group, own_assignments

_OF_ARCHIVE = ("profile", "elapsed_days")
"""Columns that the archive holds elsewhere."""

QUICK_EPOCHS, QUICK_DRAWS = 4, 10
"""What a first look takes."""


def missing_input(request: Request) -> str | None:
    """Say what is lacking: profiles enough for a trend."""
    with open_for_reading(request.archive) as archive:
        done = done_profiles(archive)
    count = len(select_profiles(done, request.profiles)) if done else 0
    return None if count >= LEAST else f"a trend takes {LEAST} finished profiles or more, and these are {count}"


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
    write_whole(request.archive, NAME, {**slopes_to_keep(studied.slopes), **changes_to_keep(changes)})
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


def _stored(studied: Studied) -> dict[int, dict[str, Any]]:
    """Rows of the archive's table by position, without what is missing."""
    return {
        studied.mission.where[row["profile"]]: {
            str(name): value for name, value in row.items() if name not in _OF_ARCHIVE and not pd.isna(value)
        }
        for row in studied.table.to_dict("records")
    }


STUDY = Study(NAME, "long-term drift: is the hull fouling, since when, how much, how sure", missing_input, run)
"""What the registry finds."""
