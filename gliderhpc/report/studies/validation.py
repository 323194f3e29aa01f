"""Comparison of the forward model with the records: Figure 1, table and captions, from an archive alone."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.archive.reader import Archive
from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.drawing import (
    FILTER,
    GLIDE_ANGLE,
    LANDSCAPE,
    MEASURED,
    MODEL,
    label,
    legend,
    mark_empty,
    panels,
    style_axes,
)
from gliderhpc.findings.formatting import number
from gliderhpc.findings.results import Findings, archive_findings, as_plain
from gliderhpc.report.studies.summaries import describe_data, describe_profiles, median_of
from gliderhpc.studies.archived import (
    Provenance,
    column_medians,
    failed_profiles,
    mission_of,
    provenance_of,
    stored_attribute,
    study_table,
)
from gliderhpc.studies.library.trends import Trend, find_trend
from gliderhpc.studies.validation import GROUP
from gliderhpc.wording import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

SHOWN = 2
"""Number of consecutive profiles in the upper panels."""

PAUSE = 0.25
"""Longest interval shown between profiles, hours; dives may be days apart."""

_HOURS = f"hours, breaks shortened to {PAUSE:g}"


def figure_1(archive: Archive, table: pd.DataFrame, trend: Trend) -> Figure:
    """Draw (a) depth and pitch, (b) heading, (c) longitudinal RMSE and (d) horizontal error rate over the mission.

    Parameters
    ----------
    archive : Archive
        Archive with results in its group `validation`.
    table : pandas.DataFrame
        One row for each profile, as the study writes it.
    trend : Trend
        Trend of the longitudinal RMSE.
    """
    title = f"Forward model against the records: {mission_of(archive)}"
    figure, (vertical, heading, longitudinal, horizontal) = panels(2, 2, LANDSCAPE, title)
    # The forward model also flies profiles that could not be inverted; the archive has no records of these.
    numbers = [number for number in map(int, table["profile"]) if not np.isnat(_clock(archive, number)).all()][:SHOWN]
    if numbers:
        measured, modelled = (_join_records(archive, group, numbers) for group in ("observed", "validation"))
        _draw_vertical(vertical, measured, modelled, numbers)
        _draw_heading(heading, measured, modelled)
    else:
        for axes in (vertical, heading):
            mark_empty(axes, "no profile could be inverted: the archive has no records")
    _draw_longitudinal(longitudinal, table, trend)
    _draw_horizontal(horizontal, table)
    return figure


def _join_records(archive: Archive, group: str, numbers: list[int]) -> dict[str, Array]:
    """Concatenate the records of some profiles, separated by NaN to interrupt the lines."""
    joined: dict[str, list[Array]] = {name: [] for name in ("time", "depth", "pitch", "heading")}
    first, shown = _clock(archive, numbers[0])[0], 0.0
    for profile in numbers:
        time = _clock(archive, profile)
        known = ~np.isnat(time)
        columns = archive[group].to_dataset().sel(profile=profile)
        hours = (time[known] - first) / np.timedelta64(3600, "s")
        hours -= max(0.0, float(hours[0]) - shown - PAUSE)
        shown = float(hours[-1])
        joined["time"].append(hours)
        for name in ("depth", "pitch", "heading"):
            joined[name].append(columns[name].values[known].astype(np.float64))
        for parts in joined.values():
            parts.append(np.array([np.nan]))
    return {name: np.concatenate(parts) for name, parts in joined.items()}


def _clock(archive: Archive, number: int) -> NDArray[np.datetime64]:
    times: NDArray[np.datetime64] = archive["observed"].to_dataset()["time"].sel(profile=number).values
    return times


def _draw_vertical(axes: Axes, measured: dict[str, Array], modelled: dict[str, Array], numbers: list[int]) -> None:
    hours = measured["time"]
    names = f"profile {numbers[0]}" + (f" to {numbers[-1]}" if len(numbers) > 1 else "")
    label(axes, f"(a) depth (below) and pitch (above), {names}", _HOURS, "depth (m)")
    axes.plot(hours, measured["depth"], color=MEASURED, linewidth=1.6, label="measured")
    axes.plot(hours, modelled["depth"], color=MODEL, linewidth=0.9, label="forward model")
    deepest = float(np.nanmax([measured["depth"], modelled["depth"]]))
    axes.set_ylim(1.05 * deepest, -0.9 * deepest)
    axes.set_yticks([tick for tick in axes.get_yticks() if 0.0 <= tick <= deepest])
    legend(axes, "lower right")
    pitch = axes.twinx()
    style_axes(pitch)
    pitch.spines["right"].set_visible(True)
    pitch.grid(False)
    pitch.plot(hours, measured["pitch"], color=MEASURED, linewidth=1.6)
    pitch.plot(hours, modelled["pitch"], color=MODEL, linewidth=0.9)
    steepest = 5.0 * np.ceil(max(float(np.nanpercentile(np.abs(measured["pitch"]), 99.0)), 10.0) / 5.0)
    pitch.set_ylim(-4.2 * steepest, 1.4 * steepest)
    pitch.set_yticks([-steepest, 0.0, steepest])
    label(pitch, y="pitch (°)")


def _draw_heading(axes: Axes, measured: dict[str, Array], modelled: dict[str, Array]) -> None:
    hours = measured["time"]
    label(axes, "(b) heading", _HOURS, "heading (°)")
    axes.plot(hours, measured["heading"], ".", color=MEASURED, markersize=2.0, label="measured")
    axes.plot(hours, modelled["heading"], ".", color=MODEL, markersize=1.0, label="forward model")
    axes.set_ylim(0.0, 360.0)
    axes.set_yticks(range(0, 361, 90))
    legend(axes)


def _draw_longitudinal(axes: Axes, table: pd.DataFrame, trend: Trend) -> None:
    days = table["elapsed_days"].to_numpy()
    label(axes, "(c) longitudinal RMSE per profile", "days", "RMSE (dimensionless)")
    if not np.isfinite(table["longitudinal_rmse"]).any():
        mark_empty(axes, "no steady glide is long enough for a comparison")
        return
    axes.plot(days, table["longitudinal_rmse"], ".", color=MODEL, markersize=5.0, label="profiles")
    if np.isfinite(trend.slope):
        text = f"Theil-Sen {trend.change_text} (Mann-Kendall p = {trend.p:.2g})"
        axes.plot([trend.begin, trend.end], [trend.first, trend.last], color=FILTER, linewidth=1.2, label=text)
    axes.set_ylim(0.0, 1.15 * float(table["longitudinal_rmse"].max()))
    legend(axes)


def _draw_horizontal(axes: Axes, table: pd.DataFrame) -> None:
    label(axes, "(d) horizontal error at the profile's end over the path", "days", "error rate (%)")
    styles = {
        "horizontal_error_rate": (GLIDE_ANGLE, "from glide-angle dead reckoning"),
        "surfacing_error_rate": (MODEL, "from the surfacing fix"),
    }
    for name, (colour, text) in styles.items():
        if name in table:
            axes.plot(
                table["elapsed_days"],
                100.0 * table[name],
                ".-",
                color=colour,
                markersize=5.0,
                linewidth=0.6,
                label=text,
            )
    axes.set_ylim(bottom=0.0)
    legend(axes)


def comparisons(table: pd.DataFrame, trend: Trend) -> tuple[Comparison, ...]:
    """Return the comparisons for the simulated profiles."""
    first = trend.first if np.isfinite(trend.first) else float(table["longitudinal_rmse"].iloc[0])
    last = trend.last if np.isfinite(trend.last) else float(table["longitudinal_rmse"].iloc[-1])
    known = np.isfinite(trend.first)
    ends = "fitted line's end" if known else "too few profiles for a trend: its own value"
    tested = f"tau {trend.tau:+.2f}, n = {trend.count}; paper 7.5e-06" if known else "too few profiles for a trend"
    return (
        Comparison("longitudinal RMSE, start of the mission", "1", first, 0.048, remark=ends),
        Comparison("longitudinal RMSE, end of the mission", "1", last, 0.080, remark=ends),
        Comparison("its relative rise", "1", trend.change, 0.66),
        Comparison("its Mann-Kendall p", "1", trend.p, remark=tested),
        Comparison("depth RMSE per profile, median", "m", median_of(table, "depth_rmse")),
        Comparison("pitch RMSE per profile, median", "degree", median_of(table, "pitch_rmse")),
        Comparison("heading RMSE per profile, median", "degree", median_of(table, "heading_rmse")),
        Comparison("part of the dive before the model surfaces, median", "1", median_of(table, "flown_fraction")),
        Comparison("distance of track end from dead reckoning / path", "1", median_of(table, "horizontal_error_rate")),
        Comparison("distance of track end, recorded heading", "m", median_of(table, "horizontal_error_on_course")),
        Comparison("distance of track end from exit fix / path", "1", median_of(table, "surfacing_error_rate")),
        Comparison("track's end from the exit fix", "m", median_of(table, "surfacing_error")),
        Comparison("dead reckoning's end from the exit fix", "m", median_of(table, "surfacing_error_glide_angle")),
    )


def captions(provenance: Provenance, table: pd.DataFrame, trend: Trend, platform: Mapping[str, Any]) -> dict[str, str]:
    """Return the captions by stem."""
    numbers = table["profile"].tolist()
    flown = (
        f"the fixed-parameter model of {platform['name']}, driven open loop by the recorded controls in still water: "
        f"{describe_data(provenance, numbers)}"
    )
    changes = (
        f"The longitudinal error changes by {trend.change_text} over the mission (Mann-Kendall p = {number(trend.p)}, "
        "which serial correlation makes too small)."
        if np.isfinite(trend.slope)
        else f"{counted(len(table), 'profile is', 'profiles are')} too few for a trend."
    )
    doubt = (
        "Depth and horizontal errors grow with the time flown; the current affects the distance from the fix, but "
        "neither track includes it."
    )
    return {
        "figure_1": (
            f"Records and {flown}. Panels (a) and (b): {describe_profiles(numbers[:SHOWN])}; (c) and (d): the "
            f"mission. {changes} {doubt}"
        ),
        "profiles": (
            f"Errors over steady glide, one row per profile, of {flown}; where flown_fraction is below 1, the model "
            f"reaches the surface before the end of the record. {changes} {doubt}"
        ),
    }


def show(archive: Archive) -> Findings:
    """Show the validation of an archive."""
    provenance = provenance_of(archive, GROUP)
    failed, flown = failed_profiles(study_table(archive, GROUP))
    table = flown.drop(columns="message", errors="ignore").reset_index(drop=True)
    trend, platform = (
        find_trend(table["elapsed_days"], table["longitudinal_rmse"]),
        stored_attribute(archive, GROUP, "platform"),
    )
    facts = {
        "trend": as_plain(trend.as_json()),
        "platform": platform,
        "settings": provenance.settings,
        "medians": column_medians(table),
    }
    return archive_findings(
        GROUP,
        comparisons=comparisons(table, trend),
        tables={"profiles": table},
        figures={"figure_1": partial(figure_1, archive, table, trend)},
        facts=facts,
        failed=failed,
        remarks=provenance.remarks,
        captions=captions(provenance, table, trend, platform),
    )
