"""Study ``reconstruction``: comparisons with the paper: tracking, open loop, cost, self-motion, yaw moment, truth."""

from __future__ import annotations

import numpy as np
import pandas as pd

from gliderhpc.archive.profile import TRACKED
from gliderhpc.findings.findings import Comparison
from gliderhpc.platform import Platform
from gliderhpc.report.studies.summaries import median_of
from gliderhpc.store_schema.columns import regime_column, tracked_column

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
