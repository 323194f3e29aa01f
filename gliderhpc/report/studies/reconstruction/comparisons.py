"""Comparisons with the paper and captions of study ``reconstruction``."""

import numpy as np
import pandas as pd

from gliderhpc.archive.profile import TRACKED
from gliderhpc.estimation.quality import SEGMENT
from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.tables import number
from gliderhpc.platform import Platform
from gliderhpc.report.captions import describe_data, describe_profiles, estimate_label
from gliderhpc.store_schema.studies.reconstruction import regime_column, tracked_column
from gliderhpc.studies.provenance import Provenance

STEADY = {"roll": 2.4, "pitch": 2.3, "heading": 2.15, "depth": 0.31}
VIBRATION = {"roll": 16.2, "pitch": 10.2, "heading": 11.1, "depth": 1.20}
"""Profile 18 with k_z = 0: root mean square residuals, degree and m (section 5.1.1)."""

OPEN_LOOP = {
    "adjoint": {"roll": 0.057, "pitch": 0.280, "heading": 0.097, "depth": 0.014},
    "prior": {"roll": 0.078, "pitch": 1.015, "heading": 3.340, "depth": 2.985},
}
"""Lower block of Table 2."""

LABELS = {"adjoint": "adjoint", "smoothed": "smoother", "prior": "filter"}
"""Names of the archive's estimates."""


def comparisons(
    table: pd.DataFrame, channels: pd.DataFrame, impulses: pd.DataFrame, platform: Platform, estimate: str
) -> tuple[Comparison, ...]:
    """Every figure that the paper states, and related ones; medians over the profiles.

    Parameters
    ----------
    table : pandas.DataFrame
        A row a profile.
    channels, impulses : pandas.DataFrame
        Against the truth; empty where there is none.
    platform : Platform
        The hull, for what k_z should show.
    estimate : str
        Whose disturbances and motion the table is made from.
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
        steady, vibrating = _median(table, f"{prefix}steady_{name}"), _median(table, f"{prefix}vibration_{name}")
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
        Comparison("heave disturbance's slope with depth, k_z = 0 less nominal", "N/m",
                   _median(table, "no_slope_heave_slope"), remark=expected),
        Comparison("self-motion changed by k_z = 0", "1", _median(table, "no_slope_self_motion")),
    ]  # fmt: skip


def _open_loop(table: pd.DataFrame, estimate: str) -> list[Comparison]:
    if f"open_loop_{estimate}_roll" not in table:
        return []
    return [
        Comparison(f"open loop 600 s, {LABELS[estimator]}, {name}", TRACKED[name],
                   _median(table, tracked_column(f"open_loop_{estimator}", name)),
                   OPEN_LOOP.get(estimator, {}).get(name))
        for estimator in (estimate, "prior")
        for name in TRACKED
    ]  # fmt: skip


def _costs(table: pd.DataFrame) -> list[Comparison]:
    rows = [
        Comparison("iterations a window", "1", _median(table, "iterations_median"), 37.0),
        Comparison("their interquartile range", "1", _median(table, "iterations_spread"), 4.0),
        Comparison("their maximum", "1", float(table["iterations_most"].max()), 69.0),
        Comparison("time a window", "s", _median(table, "window_seconds"), 4.1, remark="everything the profile takes"),
        Comparison("time a dive", "min", _median(table, "profile_seconds") / 60.0, 26.6),
    ]
    if "filter_seconds" in table:
        rows.append(Comparison("time a dive, filter", "min", _median(table, "filter_seconds") / 60.0, 0.85))
    return rows


def _motion(table: pd.DataFrame, estimate: str) -> list[Comparison]:
    spread = table["self_motion_spread"].to_numpy()
    return [
        Comparison("vibration's share of the dive", "1", _median(table, "vibration_fraction"), (0.063, 0.084)),
        Comparison("displacement in it over the dive's time", "m/s", _median(table, "vibration_speed"), (0.03, 0.05)),
        Comparison("the same over the depth-averaged current", "1", _median(table, "vibration_share"), (0.10, 0.44)),
        Comparison(f"self-motion, {LABELS[estimate]} against glide angle, RMS", "1",
                   float(np.sqrt(np.nanmean(spread**2))) if np.isfinite(spread).any() else float("nan"), 0.18),
        Comparison("horizontal speed in steady glide, the same", "1", _median(table, "self_motion_speed_spread")),
    ]  # fmt: skip


def _regimes(table: pd.DataFrame, estimate: str) -> list[Comparison]:
    rows = []
    for regime, when in (("resting", "battery at rest"), ("rotated", "battery rotated")):
        for statistic, unit, text in (
            ("std", "N m", "standard deviation"), ("peak", "N m", "peak"), ("kurtosis", "1", "kurtosis"),
            ("fast", "1", "variance above 0.05 Hz"),
        ):  # fmt: skip
            for estimator in (estimate, "prior"):
                value = _median(table, regime_column(estimator, regime, statistic))
                rows.append(Comparison(f"yaw moment, {when}, {text}, {LABELS[estimator]}", unit, value))
    return [
        *rows,
        Comparison(f"yaw moment, filter's lag behind the {LABELS[estimate]}", "s", _median(table, "yaw_lag")),
        Comparison("yaw moment, correlation at that lag", "1", _median(table, "yaw_correlation")),
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


def _median(table: pd.DataFrame, name: str) -> float:
    return float(table[name].median()) if name in table else float("nan")


_NO_ERROR = (
    "Residuals measure how closely the records are followed, not how true the disturbance is: what the estimate puts "
    "into a disturbance cannot show as a residual."
)


def captions(
    made: Provenance, table: pd.DataFrame, channels: pd.DataFrame, impulses: pd.DataFrame, drawn: list[int]
) -> dict[str, str]:
    """Captions by stem; `drawn` are the profiles of Figure 3."""
    estimate = estimate_label(made)
    own = {
        "profiles": _of_profiles(made, table),
        "figure_2": (
            f"Profile {made.profiles[0]}: measured attitude and depth, and the motion that {estimate} reconstructs, "
            "and both tracks closed on the GPS fixes. Grey: actuators moving, left out of the residuals named. "
            f"{_NO_ERROR}"
        ),
        "figure_3": (
            f"Yaw moment by {estimate} and by the filter, with heading and battery rotation: "
            f"{describe_profiles(drawn)}. {_lag_text(made, table)} Neither carries an error here; with the battery "
            "rotated (blue) errors of the hull's model show in both."
        ),
    }
    truth = f"{describe_data(made)} of a synthetic mission whose truth is known"
    if not channels.empty:
        own["recovery"] = (
            f"Lag and gain of every disturbance by {estimate} and by the filter, and delay and height of "
            f"{len(impulses)} yaw impulses, against the truth: {truth}. The truth shares the "
            "estimator's equations, so an error of the model itself is not in it."
        )
    return own | {
        "channels": f"Lag, correlation and gain against the truth, a row a profile, channel and estimator: {truth}.",
        "impulses": (
            f"Every true yaw impulse that stands alone in steady glide, and delay and height of the peak that "
            f"{estimate} and the filter show within seconds of it: {len(impulses)} impulses in {truth}."
        ),
    }


def _lag_text(made: Provenance, table: pd.DataFrame) -> str:
    known = table.loc[table["yaw_lag"].notna(), ["profile", "yaw_lag"]]
    if known.empty:
        return "No lag of the filter behind it could be determined."
    lag = number(float(known["yaw_lag"].median()))
    return f"The filter is {lag} s behind (median of {describe_data(made, known['profile'].tolist())})."


def _of_profiles(made: Provenance, table: pd.DataFrame) -> str:
    flown = int(table["segment_start"].notna().sum()) if "segment_start" in table else 0
    second = int(table["no_slope_steady_roll"].notna().sum()) if "no_slope_steady_roll" in table else 0
    return (
        f"A row a profile: {describe_data(made)}, estimate of {estimate_label(made)}. Root mean square residuals over "
        f"steady glide and over the vibration intervals; {flown} flown open loop for {SEGMENT:g} s, {second} inverted "
        f"again with k_z = 0. {_NO_ERROR}"
    )
