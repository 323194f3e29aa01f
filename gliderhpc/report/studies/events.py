"""Catalogue, figure, comparisons and captions of study ``events``, from its group of an archive."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from gliderhpc.archive.profile import read_profile_data
from gliderhpc.archive.reader import Archive
from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.drawing import FILTER, MODEL, SMALL, TRUTH, label, legend, panels
from gliderhpc.findings.formatting import number
from gliderhpc.findings.results import Findings, archive_findings
from gliderhpc.report.studies.summaries import describe_data, shared_facts
from gliderhpc.report.studies.turbulence import describe_series, unit_of
from gliderhpc.store_schema.columns import CATALOGUE
from gliderhpc.studies.archived import (
    Provenance,
    as_cells,
    failed_profiles,
    mission_of,
    platform_of,
    provenance_of,
    sample_interval,
    stored_attribute,
    study_table,
)
from gliderhpc.studies.events import NAME, EventSettings
from gliderhpc.studies.library.turbulence.ensembles import NullFloor

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAPER_CEILING = 0.48
"""The paper's null ceiling, N m."""

PAPER_OVER_CEILING = (1.0, 6.2)
"""Range of the paper's twelve strongest events relative to its null ceiling."""

PAPER_AMPLITUDES = (0.36, 2.98)
"""Range of the paper's strongest events, N m."""


def show(archive: Archive) -> Findings:
    """Make tables, comparisons, figure and captions of the study of an archive."""
    provenance, table, events = provenance_of(archive, NAME), study_table(archive, NAME), catalogue(archive)
    settings = EventSettings.model_validate(provenance.settings)
    stored = stored_attribute(archive, NAME, "floor")
    floor = None if stored is None else NullFloor(**stored)
    failed, studied = failed_profiles(table)
    strongest = events.head(settings.strongest)
    ranked_by = _threshold_name(settings, floor)
    facts = shared_facts(provenance) | {
        "settings": settings.model_dump(mode="json"),
        "ranked_by": ranked_by,
        "events": len(events),
    }
    remarks = (
        (*provenance.remarks, *_width_remarks(archive, strongest, provenance.estimate))
        if len(strongest)
        else provenance.remarks
    )
    times = [pd.Timestamp(str(time)).isoformat(sep=" ", timespec="milliseconds") for time in events["time"]]
    listed = events.assign(time=times)
    return archive_findings(
        NAME,
        comparisons=_comparisons(studied, strongest, settings, floor),
        tables={"events": listed, "strongest": listed.head(settings.strongest), "profiles": table},
        figures={"events": partial(events_figure, events, settings, floor, mission_of(archive))} if len(events) else {},
        facts=facts,
        failed=failed,
        remarks=remarks,
        captions=_captions(provenance, events, settings, floor, ranked_by),
    )


def catalogue(archive: Archive) -> pd.DataFrame:
    """Return the events of an archive, beginning with the strongest."""
    group = archive[NAME].to_dataset()
    events = pd.DataFrame({variable.name: as_cells(group[variable.name].values) for variable in CATALOGUE})
    # Without any event the group has one missing entry, since an array cannot be empty.
    known = events[events["amplitude"].notna()]
    return known.assign(source_profile=known["source_profile"].astype(int))


def _threshold_name(settings: EventSettings, floor: NullFloor | None) -> str:
    if settings.threshold is not None:
        return "threshold as set"
    return "noise floor" if floor is None else "null ceiling"


def _width_remarks(archive: Archive, strongest: pd.DataFrame, estimate: str) -> tuple[str, ...]:
    """Describe how many of the strongest events are too narrow for the records to resolve their shape."""
    first = read_profile_data(archive, int(strongest["source_profile"].iloc[0]), estimate)
    interval = sample_interval(first, platform_of(archive))
    narrow = int((strongest["width"] < 2.0 * interval).sum())
    if not narrow:
        return ()
    return (
        f"{narrow} of the {len(strongest)} strongest are narrower than two sample intervals ({2.0 * interval:g} s): a "
        "false sample of the record looks the same",
    )


def _comparisons(
    studied: pd.DataFrame, strongest: pd.DataFrame, settings: EventSettings, floor: NullFloor | None
) -> tuple[Comparison, ...]:
    unit = unit_of(settings.channel)
    amplitudes, ratios = strongest["amplitude"].abs(), strongest["over_ceiling"]
    few = "" if floor is None or floor.decides else f"of {floor.nulls} nulls, too few to judge events"
    return (
        Comparison("null ceiling", unit, float("nan") if floor is None else floor.ceiling, PAPER_CEILING, remark=few),
        Comparison(
            "events, all profiles",
            "1",
            float(studied["count"].sum()) if len(studied) else float("nan"),
            remark="cannot be judged" if few else "",
        ),
        Comparison(
            "amplitude of the strongest, median",
            unit,
            float(amplitudes.median()),
            PAPER_AMPLITUDES,
            _range(amplitudes),
            remark=f"{len(strongest)} events, spread is their range",
        ),
        Comparison(
            "the same over the threshold",
            "1",
            float(ratios.median()),
            PAPER_OVER_CEILING,
            _range(ratios),
            paper_text="up to 6",
            remark="spread is their range",
        ),
        Comparison("their width at half the amplitude, median", "s", float(strongest["width"].median())),
    )


def _range(values: pd.Series) -> tuple[float, float] | None:
    return (float(values.min()), float(values.max())) if len(values) else None


# Captions


def _captions(
    provenance: Provenance, events: pd.DataFrame, settings: EventSettings, floor: NullFloor | None, ranked_by: str
) -> dict[str, str]:
    """Describe the data of the catalogue, and the uncertainty of its entries."""
    searched = (
        f"{describe_series(provenance, settings)}, in {describe_data(provenance)}"
        f"{', actuated samples included' if settings.actuated else ', actuated samples left out'}"
    )
    text = (
        f"Peaks of {searched}: {len(events)} above {_describe_threshold(settings, floor, ranked_by)}; of two peaks "
        f"within {settings.separation:g} s only the larger counts."
    )
    doubt = (
        "An event shows a moment on the hull, not its cause: a false sample of the record or an unrecorded motion of "
        "an actuator gives one too."
    )
    return {
        # One text serves the figure and its table, which have the same name.
        "events": f"{text} Their positions are on the track closed on the fixes; without fixes they have none. {doubt}",
        "strongest": f"{text} The table lists the strongest {min(len(events), settings.strongest)}. {doubt}",
        "profiles": f"Noise floor and number of events per profile. {text}",
    }


def _describe_threshold(settings: EventSettings, floor: NullFloor | None, ranked_by: str) -> str:
    unit = unit_of(settings.channel)
    if settings.threshold is not None:
        return f"the {ranked_by}, {number(settings.threshold)} {unit}"
    if floor is None:
        return f"{settings.sigma:g} times each profile's own {ranked_by}, as there are no nulls to rank them by"
    few = "" if floor.decides else f" (of {floor.nulls} nulls, too few to judge events)"
    return f"the {ranked_by}, {number(floor.ceiling)} {unit}{few}"


# Figure


def events_figure(events: pd.DataFrame, settings: EventSettings, floor: NullFloor | None, title: str) -> Figure:
    """Draw (a) the events' amplitudes by depth and (b) the strongest in order."""
    unit, strongest = unit_of(settings.channel), events.head(settings.strongest)
    figure, (by_depth, ranked) = panels(1, 2, (10.5, 5.0), f"Events of {settings.channel}: {title}")
    by_depth.plot(events["amplitude"], events["depth"], "o", color=MODEL, markersize=3.0, alpha=0.6)
    by_depth.plot(strongest["amplitude"], strongest["depth"], "o", color=FILTER, markersize=4.0, label="strongest")
    by_depth.invert_yaxis()
    by_depth.set_xscale("symlog", linthresh=float(events["amplitude"].abs().min()))
    ranked.set_yscale("log")
    rank = np.arange(len(strongest))
    ranked.bar(rank, strongest["amplitude"].abs(), color=FILTER, width=0.7)
    ranked.set_xticks(rank, [str(profile) for profile in strongest["source_profile"]], fontsize=SMALL)
    if floor is not None:
        for sign in (-1.0, 1.0):
            by_depth.axvline(sign * floor.ceiling, color=TRUTH, linewidth=0.7, linestyle="--")
        ranked.axhline(floor.ceiling, color=TRUTH, linewidth=0.9, linestyle="--", label="null ceiling")
    label(by_depth, f"(a) {len(events)} events", f"amplitude ({unit})", "depth (m)")
    label(ranked, "(b) the strongest", "profile", f"magnitude ({unit})")
    legend(by_depth)
    legend(ranked)
    return figure
