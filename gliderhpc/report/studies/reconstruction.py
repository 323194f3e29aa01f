"""Study ``reconstruction``: Figures 2 and 3, recovery of a truth, tables, comparisons and captions, from its group."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.archive.profile import TRACKED, ProfileData, read_profile_data
from gliderhpc.archive.reader import Archive
from gliderhpc.estimation.quality import SEGMENT
from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.drawing import (
    ESTIMATE,
    FILTER,
    GLIDE_ANGLE,
    LANDSCAPE,
    MEASURED,
    SHADE,
    TRUTH,
    label,
    legend,
    limits,
    panels,
    shade,
)
from gliderhpc.findings.formatting import number
from gliderhpc.findings.results import Findings, archive_findings
from gliderhpc.platform import Platform
from gliderhpc.report.studies.summaries import describe_data, describe_profiles, estimate_label, median_of, shared_facts
from gliderhpc.store_schema.columns import regime_column, tracked_column
from gliderhpc.studies.archived import (
    Provenance,
    column_medians,
    failed_profiles,
    mission_of,
    platform_of,
    provenance_of,
    stored_attribute,
    study_table,
)
from gliderhpc.studies.library.filter_comparison import YAW, channel_table, impulse_table, stored_yaw
from gliderhpc.studies.library.scores import rms
from gliderhpc.studies.library.tracks import anchored_tracks, motions_of
from gliderhpc.studies.reconstruction import NAME

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

FIGURE_3_PROFILES = 3
_UNITS = {"degree": "°", "m": "m"}
_ROTATED = "#56B4E9"

_NO_ERROR = (
    "Residuals measure how closely the records are followed, not how accurate the disturbance is: whatever the "
    "estimate attributes to a disturbance does not appear in a residual."
)


def captions(
    provenance: Provenance, table: pd.DataFrame, channels: pd.DataFrame, impulses: pd.DataFrame, drawn: list[int]
) -> dict[str, str]:
    """Return the captions by stem; `drawn` are the profiles of Figure 3."""
    estimate = estimate_label(provenance)
    own = {
        "profiles": _profiles_caption(provenance, table),
        "figure_2": (
            f"Profile {provenance.profiles[0]}: measured attitude and depth, the motion that {estimate} reconstructs, "
            "and both tracks, closed on the GPS fixes if there are any. Grey: actuators moving, excluded from the "
            f"residuals given. {_NO_ERROR}"
        ),
        "figure_3": (
            f"Yaw moment from {estimate} and from the filter, with heading and battery rotation: "
            f"{describe_profiles(drawn)}. {_lag_text(provenance, table)} Neither is shown with its uncertainty; with "
            "the battery rotated (blue) errors of the hull's model appear in both."
        ),
    }
    truth = f"{describe_data(provenance)} of a synthetic mission whose truth is known"
    if not channels.empty:
        own["recovery"] = (
            f"Lag and gain of every disturbance from {estimate} and from the filter, and delay and height of "
            f"{len(impulses)} yaw impulses, against the truth: {truth}. The truth was simulated with the estimator's "
            "equations, so errors of the model itself are not included."
        )
    return own | {
        "channels": (
            f"Lag, correlation and gain against the truth, one row per profile, channel and estimator: {truth}."
        ),
        "impulses": (
            f"Every isolated true yaw impulse in steady glide, and delay and height of the peak that "
            f"{estimate} and the filter show within seconds of it: {len(impulses)} impulses in {truth}."
        ),
    }


def _lag_text(provenance: Provenance, table: pd.DataFrame) -> str:
    known = table.loc[table["yaw_lag"].notna(), ["profile", "yaw_lag"]]
    if known.empty:
        return "The lag of the filter could not be determined."
    lag = number(float(known["yaw_lag"].median()))
    return f"The filter lags by {lag} s (median of {describe_data(provenance, known['profile'].tolist())})."


def _profiles_caption(provenance: Provenance, table: pd.DataFrame) -> str:
    flown = int(table["segment_start"].notna().sum()) if "segment_start" in table else 0
    second = int(table["no_slope_steady_roll"].notna().sum()) if "no_slope_steady_roll" in table else 0
    return (
        f"One row per profile: {describe_data(provenance)}, estimate of {estimate_label(provenance)}. Root mean square "
        f"residuals over steady glide and over the vibration intervals; {flown} flown open loop for {SEGMENT:g} s, "
        f"{second} inverted again with k_z = 0. {_NO_ERROR}"
    )


def figure_2(archive: Archive, number: int, estimate: str) -> Figure:
    """Draw one profile: attitude and depth with the records, X and Y with dead reckoning and fixes."""
    data = read_profile_data(archive, number, estimate)
    title = f"Reconstruction of profile {number}: {mission_of(archive)}"
    figure, axes = panels(3, 2, LANDSCAPE, title)
    minutes = data.record_time / 60.0
    for column, (name, unit) in enumerate(TRACKED.items()):
        _draw_tracked(axes[column], data, column, name, unit)
    motions = motions_of(data, platform_of(archive))
    tracks = anchored_tracks(archive, data, motions.estimate, motions.glide_angle)
    for axis, (panel, name) in enumerate(zip(axes[4:], ("X, north", "Y, east"), strict=True)):
        apart = "" if tracks is None else f" (the two tracks {tracks.spread:.0f} m apart, RMS)"
        label(panel, f"{name} of the entry fix{apart}", "minutes", "m")
        if tracks is None:
            label(panel, f"{name}: a fix is missing")
            continue
        for track, colour, style, text in (
            (tracks.estimate, ESTIMATE, "-", LABELS[estimate]),
            (tracks.glide_angle, GLIDE_ANGLE, "--", "glide-angle dead reckoning"),
        ):
            own = f"{text}, closed on the fixes"
            panel.plot(minutes, track[:, axis], color=colour, linewidth=1.0, linestyle=style, label=own)
        panel.plot(tracks.fix_time / 60.0, tracks.fixes[:, axis], "^", color=TRUTH, markersize=5, label="GPS fix")
        legend(panel)
    return figure


def _draw_tracked(axes: Axes, data: ProfileData, column: int, name: str, unit: str) -> None:
    minutes, steady = data.record_time / 60.0, data.steady_records
    residual = rms(data.residuals[steady, column])
    space = "" if unit == "degree" else " "
    title = f"{name}: residual {residual:.3g}{space}{_UNITS[unit]} RMS in steady glide"
    label(axes, title, "minutes", f"{name} ({_UNITS[unit]})")
    axes.plot(minutes, data.measured[:, column], ".", color=MEASURED, markersize=2.5, label="measured")
    axes.plot(minutes, data.reconstructed[:, column], color=ESTIMATE, linewidth=0.8, label="reconstructed")
    shade(axes, minutes, data.on_records(data.flagged("vibration")), "actuators moving")
    if name == "depth":
        axes.invert_yaxis()
    if column == 0:
        legend(axes)


def figure_3(archive: Archive, numbers: list[int], estimate: str) -> Figure:
    """Draw yaw moment of adjoint (or smoother) and filter, heading and battery rotation, one column for each profile.

    The truth is drawn too if the study used one.
    """
    title = f"Yaw moment by {LABELS[estimate]} and filter: {mission_of(archive)}"
    figure, axes = panels(4, len(numbers), LANDSCAPE, title, share_x=True)
    count = len(numbers)
    for column, profile in enumerate(numbers):
        data = read_profile_data(archive, profile, estimate)
        own = [axes[row * count + column] for row in range(4)]
        _draw_estimators(own, data, stored_yaw(archive, data), first=column == 0)
    return figure


def _draw_estimators(axes: list[Axes], data: ProfileData, truth: Array | None, first: bool) -> None:
    minutes = data.time / 60.0
    curves = {
        LABELS[data.estimate]: (data.disturbances[:, YAW], ESTIMATE),
        LABELS["prior"]: (data.prior[:, YAW], FILTER),
    }
    span = limits(np.concatenate([values[data.steady] for values, _ in curves.values()]), 0.02)
    for panel, (name, (values, colour)) in zip(axes, curves.items(), strict=False):
        if truth is not None:
            panel.plot(minutes, truth, color=TRUTH, linewidth=0.5, label="truth")
        panel.plot(minutes, values, color=colour, linewidth=0.8, label=name)
        panel.set_ylim(*span)
        label(panel, f"profile {data.number}" if panel is axes[0] else "", y="$B_{cr}$ (N m)" if first else "")
        legend(panel, "upper right")
    records = data.record_time / 60.0
    axes[2].plot(records, data.measured[:, 2], color=MEASURED, linewidth=0.8)
    label(axes[2], y="heading (°)" if first else "")
    axes[3].plot(records, data.controls[:, 1], color=TRUTH, linewidth=0.8)
    axes[3].set_ylim(*_at_least_a_degree(data.controls[:, 1]))
    label(axes[3], x="minutes", y="battery rotation (°)" if first else "")
    for panel in axes:
        rotated, moving = ("battery rotated", "actuators moving") if panel is axes[3] else (None, None)
        shade(panel, minutes, data.flagged("battery_rotated"), rotated, _ROTATED)
        shade(panel, minutes, data.flagged("vibration"), moving, SHADE)
    if first:
        legend(axes[3], "upper right")


def _at_least_a_degree(degrees: Array) -> tuple[float, float]:
    low, high = limits(degrees, 0.0)
    return min(low, -1.0), max(high, 1.0)


def recovery_figure(channels: pd.DataFrame, impulses: pd.DataFrame, estimate: str) -> Figure:
    """Draw lag and gain of each channel, and delay and height of the true impulses, for both estimators."""
    title = f"{LABELS[estimate].capitalize()} and filter against the truth"
    figure, (lag, gain, delay, height) = panels(2, 2, LANDSCAPE, title)
    styles = {estimate: ESTIMATE, "prior": FILTER}
    names = list(dict.fromkeys(channels["channel"]))
    for shift, (estimator, colour) in enumerate(styles.items()):
        rows = channels[channels["estimator"] == estimator].groupby("channel", sort=False).median(numeric_only=True)
        places = np.array([names.index(str(name)) for name in rows.index]) + 0.36 * shift - 0.18
        text = LABELS[estimator]
        lag.bar(places, rows["lag"], 0.34, color=colour, label=text)
        gain.bar(places, rows["gain"], 0.34, color=colour, label=text)
        if not impulses.empty:
            bins = np.arange(-3.0, 6.5, 0.5).tolist()
            delay.hist(impulses[f"{estimator}_delay"], bins=bins, color=colour, alpha=0.6, label=text)
            height.plot(impulses["amplitude"].abs(), impulses[f"{estimator}_ratio"], ".", color=colour, label=text)
    titles = ("lag behind the truth (none: not determined within 30 s)", "gain at that lag (1: not attenuated)")
    for axes, title, unit in zip((lag, gain), titles, ("s", ""), strict=True):
        axes.set_xticks(range(len(names)), names)
        label(axes, title, y=unit)
    label(delay, f"delay of the peak of {len(impulses)} yaw impulses", "s", "impulses")
    label(height, "their height over the true height", "true height (N m)", "ratio")
    for axes in (gain, height):
        axes.axhline(1.0, color=TRUTH, linewidth=0.6)
    for axes in (lag, gain, delay, height):
        legend(axes)
    return figure


def show(archive: Archive) -> Findings:
    """Show the study of an archive."""
    provenance, table, platform = provenance_of(archive, NAME), study_table(archive, NAME), platform_of(archive)
    numbers = list(provenance.profiles)
    channels, impulses = channel_table(archive, numbers), impulse_table(archive, numbers)
    flown = f"open_loop_{provenance.estimate}_roll" in table
    remarks = () if flown else ("no profile has 600 s of uninterrupted steady glide: there is no open-loop comparison",)
    tables = {"profiles": table}
    if stored_attribute(archive, NAME, "with_truth"):
        tables |= {"channels": channels, "impulses": impulses}
    drawn = numbers[:FIGURE_3_PROFILES]
    figures = {
        "figure_2": partial(figure_2, archive, numbers[0], provenance.estimate),
        "figure_3": partial(figure_3, archive, drawn, provenance.estimate),
    }
    if len(channels):
        figures["recovery"] = partial(recovery_figure, channels, impulses, provenance.estimate)
    facts = shared_facts(provenance) | {"medians": column_medians(table)}
    return archive_findings(
        NAME,
        comparisons=comparisons(table, channels, impulses, platform, provenance.estimate),
        tables=tables,
        figures=figures,
        facts=facts,
        failed=failed_profiles(table)[0],
        remarks=(*provenance.remarks, *remarks),
        captions=captions(provenance, table, channels, impulses, drawn),
    )


# Comparisons with the paper: tracking, open loop, cost, self-motion, yaw moment, truth

STEADY = {"roll": 2.4, "pitch": 2.3, "heading": 2.15, "depth": 0.31}
VIBRATION = {"roll": 16.2, "pitch": 10.2, "heading": 11.1, "depth": 1.20}
"""Profile 18 with k_z = 0: root mean square residuals, degree and m (section 5.1.1)."""

OPEN_LOOP = {
    "adjoint": {"roll": 0.057, "pitch": 0.280, "heading": 0.097, "depth": 0.014},
    "prior": {"roll": 0.078, "pitch": 1.015, "heading": 3.340, "depth": 2.985},
}
"""Values from the lower block of the paper's Table 2."""

LABELS = {"adjoint": "adjoint", "smoothed": "smoother", "prior": "filter"}
"""Names of the archive's estimates."""


def comparisons(
    table: pd.DataFrame, channels: pd.DataFrame, impulses: pd.DataFrame, platform: Platform, estimate: str
) -> tuple[Comparison, ...]:
    """Compare every value stated in the paper, and related ones, with medians over the profiles.

    Parameters
    ----------
    table : pandas.DataFrame
        One row for each profile.
    channels, impulses : pandas.DataFrame
        Comparison with the truth; empty if there is none.
    platform : Platform
        Hull, whose k_z determines the expected slope.
    estimate : str
        Estimate used for the table.
    """
    return (
        *_tracking(table, "", f"k_z = {platform.buoyancy.depth_slope:g} N/m"),
        *(_tracking(table, "no_slope_", "k_z = 0") if "no_slope_steady_roll" in table else ()),
        *_depth_slope(table, platform),
        *_open_loop(table, estimate),
        *_costs(table),
        *_motion(table, estimate),
        *_regimes(table, estimate),
        *_against_truth(channels, impulses, estimate),
    )


def _tracking(table: pd.DataFrame, prefix: str, note: str) -> list[Comparison]:
    rows = []
    for name, unit in TRACKED.items():
        steady, vibrating = median_of(table, f"{prefix}steady_{name}"), median_of(table, f"{prefix}vibration_{name}")
        ratio = vibrating / steady if steady > 0.0 else float("nan")
        rows += [
            Comparison(f"tracking RMSE, steady glide, {name}", unit, steady, STEADY[name], remark=note),
            Comparison(f"tracking RMSE, vibration, {name}", unit, vibrating, VIBRATION[name], remark=note),
            Comparison(f"vibration over steady, {name}", "1", ratio, VIBRATION[name] / STEADY[name], remark=note),
        ]
    return rows


def _depth_slope(table: pd.DataFrame, platform: Platform) -> list[Comparison]:
    if "no_slope_heave_slope" not in table:
        return []
    expected = f"-k_z is {-platform.buoyancy.depth_slope:g}"
    return [
        Comparison("heave disturbance's slope with depth, k_z = 0 minus nominal", "N/m",
                   median_of(table, "no_slope_heave_slope"), remark=expected),
        Comparison("self-motion changed by k_z = 0", "1", median_of(table, "no_slope_self_motion")),
    ]  # fmt: skip


def _open_loop(table: pd.DataFrame, estimate: str) -> list[Comparison]:
    if f"open_loop_{estimate}_roll" not in table:
        return []
    return [
        Comparison(
            f"open loop 600 s, {LABELS[estimator]}, {name}",
            TRACKED[name],
            median_of(table, tracked_column(f"open_loop_{estimator}", name)),
            OPEN_LOOP.get(estimator, {}).get(name),
        )
        for estimator in (estimate, "prior")
        for name in TRACKED
    ]


def _costs(table: pd.DataFrame) -> list[Comparison]:
    rows = [
        Comparison("iterations per window", "1", median_of(table, "iterations_median"), 37.0),
        Comparison("their interquartile range", "1", median_of(table, "iterations_spread"), 4.0),
        Comparison("their maximum", "1", float(table["iterations_most"].max()), 69.0),
        Comparison(
            "time per window", "s", median_of(table, "window_seconds"), 4.1, remark="all computations of the profile"
        ),
        Comparison("time per dive", "min", median_of(table, "profile_seconds") / 60.0, 26.6),
    ]
    if "filter_seconds" in table:
        rows.append(Comparison("time per dive, filter", "min", median_of(table, "filter_seconds") / 60.0, 0.85))
    return rows


def _motion(table: pd.DataFrame, estimate: str) -> list[Comparison]:
    spread = table["self_motion_spread"].to_numpy()
    return [
        Comparison("vibration's share of the dive", "1", median_of(table, "vibration_fraction"), (0.063, 0.084)),
        Comparison("displacement in it over the dive's time", "m/s", median_of(table, "vibration_speed"), (0.03, 0.05)),
        Comparison("its ratio to the depth-averaged current", "1", median_of(table, "vibration_share"), (0.10, 0.44)),
        Comparison(f"self-motion, {LABELS[estimate]} against glide angle, RMS", "1",
                   float(np.sqrt(np.nanmean(spread**2))) if np.isfinite(spread).any() else float("nan"), 0.18),
        Comparison("horizontal speed in steady glide, the same", "1", median_of(table, "self_motion_speed_spread")),
    ]  # fmt: skip


def _regimes(table: pd.DataFrame, estimate: str) -> list[Comparison]:
    rows = []
    for regime, when in (("resting", "battery at rest"), ("rotated", "battery rotated")):
        for statistic, unit, text in (
            ("std", "N m", "standard deviation"),
            ("peak", "N m", "peak"),
            ("kurtosis", "1", "kurtosis"),
            ("fast", "1", "variance above 0.05 Hz"),
        ):
            for estimator in (estimate, "prior"):
                value = median_of(table, regime_column(estimator, regime, statistic))
                rows.append(Comparison(f"yaw moment, {when}, {text}, {LABELS[estimator]}", unit, value))
    return [
        *rows,
        Comparison(f"yaw moment, filter's lag behind the {LABELS[estimate]}", "s", median_of(table, "yaw_lag")),
        Comparison("yaw moment, correlation at that lag", "1", median_of(table, "yaw_correlation")),
    ]


def _against_truth(channels: pd.DataFrame, impulses: pd.DataFrame, estimate: str) -> list[Comparison]:
    rows = []
    if not channels.empty:
        for (channel, estimator), group in channels.groupby(["channel", "estimator"], sort=False):
            label = f"{channel} against truth, {LABELS[str(estimator)]}"
            rows += [
                Comparison(f"{label}, lag", "s", float(group["lag"].median())),
                Comparison(f"{label}, gain at that lag", "1", float(group["gain"].median())),
            ]
    if not impulses.empty:
        count = f"{len(impulses)} impulses"
        for estimator in (estimate, "prior"):
            label = LABELS[estimator]
            ratio, delay = impulses[f"{estimator}_ratio"], impulses[f"{estimator}_delay"]
            rows += [
                Comparison(f"yaw impulses, {label}, peak over true peak", "1", float(ratio.median()), remark=count),
                Comparison(f"yaw impulses, {label}, delay of the peak", "s", float(delay.median()), remark=count),
            ]
    return rows
