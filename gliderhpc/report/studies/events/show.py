"""Tables, comparisons, figures and captions of study ``events``, from its group of an archive alone."""

import pandas as pd
import xarray as xr

from gliderhpc.archive.profile import read_profile_data
from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.findings import Findings, archive_findings
from gliderhpc.report.studies.events.captions import captions
from gliderhpc.report.studies.events.figure import events_figure
from gliderhpc.report.studies.turbulence.table_3 import unit_of
from gliderhpc.studies.archived import as_cells, failed_profiles, mission_of, platform_of, sample_interval, study_table
from gliderhpc.studies.events.settings import EventSettings
from gliderhpc.studies.events.study import NAME, of_events
from gliderhpc.studies.library.turbulence.ensembles import NullFloor
from gliderhpc.studies.provenance import kept, provenance_of

PAPER_OVER_CEILING = (1.0, 6.2)
"""The paper's twelve strongest events reach six times its null ceiling."""

PAPER_AMPLITUDES = (0.36, 2.98)


def catalogue(archive: xr.DataTree) -> pd.DataFrame:
    """Return the events of an archive, strongest first."""
    group = archive[NAME].to_dataset()
    events = pd.DataFrame({name: as_cells(group[name].values) for name in of_events()})
    # Without any event the group has one missing entry, for an array cannot be empty.
    known = events[events["amplitude"].notna()]
    return known.assign(source_profile=known["source_profile"].astype(int))


def show(archive: xr.DataTree) -> Findings:
    """Show the study of an archive."""
    made, table, events = provenance_of(archive, NAME), study_table(archive, NAME), catalogue(archive)
    settings = EventSettings.model_validate(made.settings)
    stored = kept(archive, NAME, "floor")
    floor = None if stored is None else NullFloor(**stored)
    failed, studied = failed_profiles(table)
    strongest = events.head(settings.strongest)
    ranked_by = "null ceiling" if settings.threshold is None and floor is not None else _otherwise(settings)
    facts = {
        "profiles": list(made.profiles),
        "estimate": made.estimate,
        "quick": made.quick,
        "settings": settings.model_dump(mode="json"),
        "ranked_by": ranked_by,
        "events": len(events),
    }
    remarks = (*made.remarks, *_about_widths(archive, strongest, made.estimate)) if len(strongest) else made.remarks
    shown = events.assign(time=[str(time) for time in events["time"]])
    return archive_findings(
        NAME, _comparisons(studied, strongest, settings, floor),
        {"events": shown, "strongest": shown.head(settings.strongest), "profiles": table},
        {"events": events_figure(events, settings, floor, mission_of(archive))} if len(events) else {}, facts, failed,
        remarks, captions=captions(made, events, settings, floor, ranked_by),
    )  # fmt: skip


def _about_widths(archive: xr.DataTree, strongest: pd.DataFrame, estimate: str) -> tuple[str, ...]:
    """Say how many of the strongest are too narrow for the records to have seen their shape."""
    first = read_profile_data(archive, int(strongest["source_profile"].iloc[0]), estimate)
    interval = sample_interval(first, platform_of(archive))
    narrow = int((strongest["width"] < 2.0 * interval).sum())
    if not narrow:
        return ()
    return (
        f"{narrow} of the {len(strongest)} strongest are narrower than two sample intervals ({2.0 * interval:g} s): a "
        "false sample of the record looks so",
    )


def _otherwise(settings: EventSettings) -> str:
    return "noise floor" if settings.threshold is None else "threshold as set"


def _comparisons(
    studied: pd.DataFrame, strongest: pd.DataFrame, settings: EventSettings, floor: NullFloor | None
) -> tuple[Comparison, ...]:
    unit = unit_of(settings.channel)
    amplitudes = strongest["amplitude"].abs()
    ceiling = float("nan") if floor is None else floor.ceiling
    return (
        Comparison("null ceiling", unit, ceiling, 0.48),
        Comparison("events, all profiles", "1", float(studied["count"].sum()) if len(studied) else float("nan")),
        Comparison(
            "amplitude of the strongest, median", unit, float(amplitudes.median()), PAPER_AMPLITUDES,
            _range(amplitudes), remark=f"{len(strongest)} events, spread is their range",
        ),
        Comparison(
            "the same over the threshold", "1", float(strongest["over_ceiling"].median()), PAPER_OVER_CEILING,
            _range(strongest["over_ceiling"]), paper_said="up to 6", remark="spread is their range",
        ),
        Comparison("their width at half the amplitude, median", "s", float(strongest["width"].median())),
    )  # fmt: skip


def _range(values: pd.Series) -> tuple[float, float] | None:
    return (float(values.min()), float(values.max())) if len(values) else None
