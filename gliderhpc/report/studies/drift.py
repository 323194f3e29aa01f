"""Study ``drift``: Figure 9, the drag, captions and remarks, from its group of an archive alone."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from gliderhpc.archive.profile import ADJOINT, SMOOTHED
from gliderhpc.archive.reader import Archive
from gliderhpc.findings.drawing import FILTER, LANDSCAPE, MODEL, SHADE, footnote, label, outer_legend, panels
from gliderhpc.findings.results import Findings, archive_findings
from gliderhpc.report.studies.drift_tables import comparisons, table_5, table_5_text, table_6, table_6_text
from gliderhpc.report.studies.hull import change_findings
from gliderhpc.report.studies.summaries import ESTIMATES, describe_data
from gliderhpc.store_schema.columns import median_column
from gliderhpc.studies.archived import (
    Provenance,
    failed_profiles,
    mission_of,
    platform_of,
    provenance_of,
    stored_attribute,
    study_table,
    windows_start,
)
from gliderhpc.studies.drift import NAME
from gliderhpc.studies.library.drift.change_points import SEARCHES
from gliderhpc.studies.library.drift.change_rows import change_rows, moment_rows, read_changes, read_moment_changes
from gliderhpc.studies.library.drift.change_text import change_lines, moment_lines, shaded
from gliderhpc.studies.library.drift.changes import AXIAL, MOMENTS, Change, Changes
from gliderhpc.studies.library.drift.coefficients import CoefficientSlopes, are_drawn, read_slopes
from gliderhpc.studies.library.drift.drag import OTHER_CAUSES, DragDrift
from gliderhpc.studies.library.drift.medians import (
    DRAG,
    PRIOR,
    UNITS,
    ChangeSettings,
    CoefficientSettings,
    DriftSettings,
    counted_estimates,
)
from gliderhpc.studies.library.drift.series import (
    LATERAL,
    LONGITUDINAL,
    EstimateTrends,
    SeriesTrend,
    days_of,
    of_epochs,
    values_of,
)
from gliderhpc.studies.library.drift.verdict import (
    DriftFindings,
    DriftVerdict,
    find_drift,
    slopes_of_all_samples,
    verdict_lines,
)
from gliderhpc.vocabulary import PHASES
from gliderhpc.wording import capitalised

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = {"dive": MODEL, "climb": FILTER}
_MARKS = {PRIOR: "+", ADJOINT: "o", SMOOTHED: "^"}

_NOTE = (
    "Medians over the steady glide of each profile: circles from the adjoint, triangles from the smoother, crosses "
    "from the filter where it is used for the verdict. Lines are Theil-Sen slopes: solid where the robust verdict is a "
    "drift (Mann-Kendall by the moving-block bootstrap, Holm's correction, interval of the slope without zero), dotted "
    "where only the paper's plain test and interval show one, dashed where neither does; none is drawn through a step "
    "or ramp that was found (shaded). Bars: two standard deviations within epochs. Axial and heave force are weakly "
    "observed; their levels depend on the prior and on the hull's coefficients."
)


def figure_9(
    title: str,
    table: pd.DataFrame,
    trends: Sequence[EstimateTrends],
    changes: Sequence[Change] = (),
    moments: Sequence[Change] = (),
) -> Figure:
    """Draw Figure 9: the longitudinal plane in the upper row, the lateral plane in the lower row.

    Parameters
    ----------
    title : str
        Title of the mission.
    table : pandas.DataFrame
        One row for each profile.
    trends : sequence of EstimateTrends
        Trends of each estimate to draw.
    changes : sequence of Change
        Changes of drag and axial force to shade.
    moments : sequence of Change
        Changes of the moments to shade in their panels.
    """
    figure, axes = panels(2, 3, LANDSCAPE, f"Drift of the disturbances: {title}")
    for letter, channel, panel in zip("abcdef", (*LONGITUDINAL, *LATERAL), axes, strict=True):
        label(panel, f"({letter}) {channel}", "days", UNITS[channel])
        for own in trends:
            for phase in PHASES:
                name, trend = median_column(channel, phase, own.estimate), own.trends[channel, phase]
                _draw(panel, table, name, trend, phase, own.estimate, line=_has_line(channel, changes, moments))
        _shade(panel, table, moments if channel in MOMENTS else changes)
    outer_legend(figure, axes)
    footnote(figure, _NOTE)
    return figure


def drag_figure(title: str, table: pd.DataFrame, drags: Sequence[DragDrift], changes: Sequence[Change] = ()) -> Figure:
    """Draw the change of K_D0 equivalent to the disturbances, in one panel for each estimate, with changes shaded."""
    figure, axes = panels(1, len(drags), (11.0, 4.6), f"Change of drag equivalent to the drift: {title}")
    for panel, drag in zip(axes, drags, strict=True):
        label(panel, f"{drag.estimate} estimate", "days", "change of K_D0 (kg/m)")
        for phase in PHASES:
            name = median_column(DRAG, phase, drag.estimate)
            line = _has_line(DRAG, changes, ())
            _draw(panel, table, name, drag.phases[phase], phase, drag.estimate, line=line)
        _shade(panel, table, changes)
    outer_legend(figure, axes)
    footnote(
        figure,
        "Solid: drift by the robust test (each series by itself) and the slope's interval; dotted: by the plain test "
        "and interval alone; dashed: by neither; no line through a step or ramp that was found. A change of weight in "
        "water, or of the pitch sensor's offset, has opposite effects on dive and climb; a change of drag has the same "
        "effect on both. Shaded: steps, ramps and episodes; trends of the drag are those outside the episodes. Small "
        "points: profiles outside the epochs.",
    )
    return figure


def _shade(axes: Axes, table: pd.DataFrame, changes: Sequence[Change]) -> None:
    days = days_of(table)
    half = 0.5 * float(np.median(np.diff(days))) if len(days) > 1 else 0.0
    for first, last, name in shaded(changes, float(days[-1])):
        axes.axvspan(first - half, last + half, facecolor=SHADE, alpha=0.3, linewidth=0.0, zorder=0.5, label=name)


def _has_line(quantity: str, changes: Sequence[Change], moments: Sequence[Change]) -> bool:
    """Return whether a line may describe a quantity: no step or ramp of it was found, only episodes."""
    own = [change for change in moments if quantity in change.moments]
    if quantity in (AXIAL, DRAG):
        own += changes
    return Changes(tuple(own)).allow_line


def _draw(
    axes: Axes, table: pd.DataFrame, name: str, trend: SeriesTrend, phase: str, estimate: str, *, line: bool
) -> None:
    from matplotlib.colors import to_rgba

    days, values = days_of(table), values_of(table, name)
    between = table["epoch"].isna().to_numpy()
    colour, mark = _COLOURS[phase], _MARKS[estimate]
    hollow = "none" if estimate == SMOOTHED else colour
    axes.plot(days[between], values[between], mark, color=colour, markersize=1.5, alpha=0.5, markerfacecolor=hollow)
    axes.errorbar(
        days[~between],
        values[~between],
        yerr=2.0 * trend.floor,
        fmt=mark,
        color=colour,
        ecolor=to_rgba(colour, 0.25),
        markersize=3.5,
        markerfacecolor=hollow,
        elinewidth=0.6,
        label=f"{phase}, {estimate}",
    )
    if line and trend.trend.count and trend.span > 0.0:
        style = "-" if trend.is_significant else ":" if trend.primary else "--"
        axes.plot(
            (trend.trend.begin, trend.trend.end),
            (trend.trend.first, trend.trend.last),
            style,
            color=colour,
            linewidth=1.0,
        )


def captions(
    provenance: Provenance,
    table: pd.DataFrame,
    findings: DriftFindings,
    settings: DriftSettings,
    band: Sequence[float],
    segments: int,
) -> dict[str, str]:
    """Return the captions by stem."""
    epochs = int(table["epoch"].nunique())
    data = f"{describe_data(provenance)} in {epochs} epochs, steady glide between {band[0]:.0f} and {band[1]:.0f} m"
    reference = findings.verdict.drags[0].reference
    whose = " and ".join(ESTIMATES[own.estimate] for own in findings.primary)
    shown = [f"{channel} {phase} ({own.estimate})" for own in findings.primary for channel, phase in own.drifting]
    robust = (
        f"A drift is accepted where the block-bootstrap Mann-Kendall test, after Holm's correction, and the "
        f"slope's interval ({settings.resamples} draws of epochs) agree: {', '.join(shown) or 'nowhere'}."
    )
    changes, moments = (
        " ".join(f"{capitalised(line)}." for line in lines)
        for lines in (change_lines(findings.changes, reference), moment_lines(findings.moments, findings.per_degree))
    )
    return {
        "figure_9": (
            f"Medians of the six disturbances over the mission by {whose}, separately for dive and climb: {data}. "
            f"{robust} Axial and heave force are weakly observed: their levels depend on the prior and the "
            f"coefficients. {changes} {moments}"
        ),
        "drag": f"{_drag_caption(findings.verdict, whose, data)} {changes}",
        **_change_captions(f"by {whose}: {describe_data(provenance)}", settings.changes, changes, moments),
        **_table_captions(settings.coefficients, data, robust, segments),
    }


def _drag_caption(verdict: DriftVerdict, whose: str, data: str) -> str:
    """Return the caption of the figure of the drag, without the changes."""
    reference = verdict.drags[0].reference
    change, low, high = (100.0 * value / reference for value in (verdict.change, *verdict.interval))
    return (
        f"Change of K_D0 equivalent to the disturbances, by {whose}: {data}. The change common to dive and climb is "
        f"{change:+.1f} % of K_D0 over the mission (95 % interval {low:+.1f} to {high:+.1f} %). "
        f"{capitalised(OTHER_CAUSES)}."
    )


def _table_captions(settings: CoefficientSettings, data: str, robust: str, segments: int) -> dict[str, str]:
    """Return the captions of the tables of medians, trends and slopes by stem."""
    return {
        "medians": (
            "One row per profile: medians of every disturbance and of the equivalent K_D0 by every estimate, the "
            f"filter's for comparison: {data}. Medians of too few records are left out."
        ),
        "table_5": (
            f"Trends of the twelve series of every estimate, the paper's grade and the robust verdict: {data}. {robust}"
        ),
        "table_6": (
            f"Slopes for {settings.draws} hulls whose coefficients are in error by up to {settings.error:.0%}, and "
            f"with a pitch error of {settings.pitch_offset:g} degree: {segments} steady segments of "
            f"{settings.length:g} s, inverted again by the adjoint, of {data}. The segments are a sample of the "
            "record; errors that all hulls share are not in the draws."
        ),
    }


def _change_captions(data: str, settings: ChangeSettings, changes: str, moments: str) -> dict[str, str]:
    """Return the captions of the tables of changes by stem; `data` names the estimates and the profiles."""
    search = (
        f"p is below {settings.level / SEARCHES:g}, by {settings.resamples} bootstrap missions over all positions, "
        "lengths and series"
    )
    return {
        "changes": (
            f"Steps, ramps and episodes of axial force and drag on dives, climbs and both together, {data}; one row "
            f"per change and part of the dive. A change is named if {search}. {changes}"
        ),
        "moment_changes": (
            f"Steps, ramps and episodes of the moments about the axes of roll, pitch and yaw, {data}; one row per "
            f"change, moment and phase, with 95 % intervals. A change is named if {search}, and if it tilts the hull "
            f"by {settings.smallest_tilt:g} degree or more. {moments}"
        ),
    }


def _by_information(archive: Archive, findings: DriftFindings) -> tuple[str, ...]:
    """Describe the findings of study `hull`, and any disagreement; empty if there are none."""
    finding = change_findings(archive)
    if finding is None:
        return ()
    changed, sentences = finding
    line = f"study hull, from all information of the dives on the hull: {'; '.join(sentences)}"
    if changed == (findings.verdict.cause != "none" or bool(findings.verdict.changes.found)):
        return (line,)
    return (
        line,
        "the two disagree: the medians include every force along the hull, and episodes; study hull "
        "includes only errors that persist throughout a dive, and at most one change per parameter",
    )


def show(archive: Archive) -> Findings:
    """Show the study of an archive: trends, drag and verdict are computed from the stored medians and slopes."""
    provenance, table, slopes = provenance_of(archive, NAME), study_table(archive, NAME), read_slopes(archive)
    settings = DriftSettings.model_validate(provenance.settings)
    findings = _drift_findings(archive, table, slopes, settings)
    changes, moments = findings.verdict.changes, findings.verdict.moments
    increase = settings.drag_increase
    rows_5 = table_5(findings.trends)
    rows_6 = table_6(slopes, slopes_of_all_samples(findings)) if slopes else []
    band, segments = stored_attribute(archive, NAME, "depth_band"), stored_attribute(archive, NAME, "segments")
    change_table = change_rows(changes, findings.verdict.drags[0].reference)
    facts = {
        "profiles": list(provenance.profiles),
        "epochs": [tuple(epoch["profile"].tolist()) for _, epoch in of_epochs(table).groupby("epoch")],
        "depth_band": band,
        "quick": provenance.quick,
        "settings": settings.model_dump(),
        "verdict": findings.verdict.as_json(increase),
        "segments": segments,
        "table_5": rows_5,
        "table_6": rows_6,
    }
    further = {"table_6": rows_6, "changes": change_table, "moment_changes": moment_rows(moments)}
    tables = {"medians": table, "table_5": pd.DataFrame(rows_5)}
    tables |= {stem: pd.DataFrame(rows) for stem, rows in further.items() if rows}
    figures = {
        "figure_9": partial(figure_9, mission_of(archive), table, findings.primary, changes.found, moments.found),
        "drag": partial(drag_figure, mission_of(archive), table, findings.verdict.drags, changes.found),
    }
    by_medians = verdict_lines(findings.verdict, findings.primary, increase)
    remarks = (*provenance.remarks, *_inputs(findings), *by_medians, *_by_information(archive, findings))
    documents = {
        "table_5.md": table_5_text(rows_5),
        "table_6.md": table_6_text(rows_6, settings.coefficients, findings.check),
    }
    return archive_findings(
        NAME,
        comparisons=comparisons(findings.trends, findings.verdict, slopes, findings.check, increase),
        tables=tables,
        figures=figures,
        facts=facts,
        failed=failed_profiles(table)[0],
        remarks=remarks,
        captions=captions(provenance, table, findings, settings, band, segments),
        documents=documents,
    )


def _drift_findings(
    archive: Archive, table: pd.DataFrame, slopes: Sequence[CoefficientSlopes], settings: DriftSettings
) -> DriftFindings:
    """Compute trends, drag and verdict from what the study has stored."""
    changes, moments = read_changes(archive), read_moment_changes(archive)
    counted = counted_estimates(windows_start(archive))
    return find_drift(table, platform_of(archive), settings, slopes, changes=changes, counted=counted, moments=moments)


def drift_sentences(archive: Archive) -> tuple[str, ...]:
    """Return sentences on the drift, steps and episodes of drag and moments that the study found, or an empty tuple."""
    settings = DriftSettings.model_validate(provenance_of(archive, NAME).settings)
    verdict = _drift_findings(archive, study_table(archive, NAME), read_slopes(archive), settings).verdict
    changes = change_lines(verdict.changes, verdict.drags[0].reference) if verdict.changes.found else ()
    moments = moment_lines(verdict.moments, verdict.per_degree) if verdict.moments.found else ()
    return (*((verdict.meaning,) if verdict.cause != "none" else ()), *changes, *moments)


def _inputs(findings: DriftFindings) -> tuple[str, ...]:
    """Return remarks on missing inputs."""
    remarks = []
    if findings.check is None:
        remarks.append(
            "no independent check: run `gliderhpc validate` on the archive first for the forward model's error"
        )
    if not are_drawn(findings.slopes):
        remarks.append(
            "no coefficients were drawn: the intervals include only the scatter of the profiles and an unknown heave "
            "force"
        )
    if all(drag.estimate != SMOOTHED for drag in findings.verdict.drags):
        remarks.append("the archive contains no smoothed estimate: the verdict is that of the adjoint alone")
    return tuple(remarks)
