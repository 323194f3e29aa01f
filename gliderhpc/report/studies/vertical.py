"""Study ``vertical``: figure, comparisons and captions, from its group of an archive alone."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.archive.profile import uses_measured_density
from gliderhpc.archive.reader import Archive
from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.drawing import FILTER, LANDSCAPE, MEASURED, MODEL, label, legend, limits, panels
from gliderhpc.findings.results import Findings, archive_findings
from gliderhpc.report.studies.summaries import describe_data, median_of
from gliderhpc.store_schema.columns import effect_column, leg_column
from gliderhpc.studies.archived import (
    Provenance,
    column_medians,
    failed_profiles,
    mission_of,
    platform_of,
    provenance_of,
    study_table,
)
from gliderhpc.studies.library.vertical_velocity import NAMES, ParameterErrors, half_power, hull_errors
from gliderhpc.studies.vertical import LEVELS, NAME
from gliderhpc.vocabulary import PHASES
from gliderhpc.wording import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CM = 100.0
_SHOWN = ("water_up", "water_up_std", "depth_rate", "depth_rate_still")
_LEGS = {"dive": MODEL, "climb": FILTER}


def vertical_figure(archive: Archive, table: pd.DataFrame) -> Figure:
    """Draw (a) rates over time and (b) water velocity over depth for a profile, (c) leg means, (d) effects of the hull.

    Parameters
    ----------
    archive : Archive
        Archive with results in its group `vertical`.
    table : pandas.DataFrame
        One row for each profile with velocities, as the study writes it.
    """
    title = f"Vertical velocity of the water: {mission_of(archive)}"
    figure, (rates, depths, mission, hull) = panels(2, 2, LANDSCAPE, title)
    number = int(table["profile"].iloc[0])
    vertical, observed = (archive[name].to_dataset().sel(profile=number) for name in ("vertical", "observed"))
    rows = vertical[[*_SHOWN]].assign({name: observed[name] for name in ("time", "depth")}).load()
    _draw_rates(rates, rows, number)
    _draw_depths(depths, rows, number)
    _draw_mission(mission, table)
    _draw_hull(hull, table)
    return figure


def _draw_rates(axes: Axes, rows: xr.Dataset, number: int) -> None:
    minutes = (rows["time"].values - rows["time"].values[0]) / np.timedelta64(60, "s")
    label(axes, f"(a) depth rate, profile {number}", "minutes", "cm/s, positive down")
    axes.plot(minutes, _CM * rows["depth_rate"], ".", color=MEASURED, markersize=2.0, label="measured, filtered")
    axes.plot(minutes, _CM * rows["depth_rate_still"], ".", color=MODEL, markersize=1.5, label="hull in still water")
    legend(axes)


def _draw_depths(axes: Axes, rows: xr.Dataset, number: int) -> None:
    label(axes, f"(b) the water's velocity with one standard deviation, profile {number}", "cm/s, upward", "depth (m)")
    for leg, colour in _LEGS.items():
        own = (rows["depth_rate_still"] > 0.0) if leg == "dive" else (rows["depth_rate_still"] < 0.0)
        part = rows.where(own, drop=True)
        velocity, deviation = _CM * part["water_up"].values, _CM * part["water_up_std"].values
        axes.errorbar(
            velocity,
            part["depth"].values,
            xerr=deviation,
            fmt=".",
            color=colour,
            ecolor=(*_rgb(colour), 0.15),
            markersize=2.0,
            elinewidth=0.8,
            label=leg,
        )
    axes.invert_yaxis()
    axes.axvline(0.0, color="#666666", linewidth=0.6)
    legend(axes)


def _draw_mission(axes: Axes, table: pd.DataFrame) -> None:
    label(axes, "(c) means over dives and climbs, with deviations due to hull and pitch", "days", "cm/s, upward")
    for leg, colour in _LEGS.items():
        if leg_column("mean", leg) in table:
            axes.errorbar(
                table["elapsed_days"],
                _CM * table[leg_column("mean", leg)],
                yerr=_CM * table[leg_column("mean_std", leg)],
                fmt=".",
                color=colour,
                ecolor=(*_rgb(colour), 0.3),
                markersize=5.0,
                elinewidth=1.0,
                label=leg,
            )
            means = [leg_column("mean", phase) for phase in PHASES]
            axes.set_ylim(*limits(_CM * table[[name for name in table if name in means]].to_numpy(), margin=0.5))
    axes.axhline(0.0, color="#666666", linewidth=0.6)
    legend(axes)


def _draw_hull(axes: Axes, table: pd.DataFrame) -> None:
    names = [name for name in NAMES if any(effect_column(name, leg) in table for leg in _LEGS)]
    label(axes, "(d) change of the mean for one plausible deviation of each parameter, medians", "cm/s", "")
    bar = np.arange(len(names))
    for shift, (leg, colour) in zip((-0.2, 0.2), _LEGS.items(), strict=True):
        if effect_column(names[0], leg) in table:
            changes = [_CM * float(table[effect_column(name, leg)].median()) for name in names]
            axes.barh(bar + shift, changes, height=0.35, color=colour, label=leg)
    axes.set_yticks(bar, names)
    axes.axvline(0.0, color="#666666", linewidth=0.6)
    legend(axes)


def _rgb(colour: str) -> tuple[float, float, float]:
    red, green, blue = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue


TARGET_ERROR = 0.005
"""Standard deviation of the vertical velocity required by users, m/s."""

_DOUBTFUL = 2.0


def comparisons(table: pd.DataFrame, errors: ParameterErrors) -> tuple[Comparison, ...]:
    """Return comparisons over the profiles: medians, unless stated otherwise.

    Parameters
    ----------
    table : pandas.DataFrame
        One row for each profile, as the study writes it.
    errors : ParameterErrors
        Errors of the hull's parameters, and their origin.
    """
    whose = "errors of the calibration" if errors.calibrated else "plausible deviations, not calibrated"
    window, rms = median_of(table, "window"), float(np.sqrt(table["mean_square"].mean()))
    return (
        Comparison("share of samples with a vertical velocity", "1", median_of(table, "share")),
        Comparison("window of the filter", "s", window, remark=f"half power at {1e3 * half_power() / window:.1f} mHz"),
        *(_leg_comparison(table, leg, whose) for leg in PHASES),
        Comparison("root mean square of the water's vertical velocity", "m/s", rms),
        Comparison("its standard deviation due to the depth sensor's noise", "m/s", median_of(table, "noise_std")),
        *_differences(table, whose),
        *(
            _parameter_comparison(table, parameter.key.rpartition(".")[2], leg)
            for parameter in errors.parameters
            for leg in PHASES
        ),
        *_against_truth(table),
    )


def remarks_on(table: pd.DataFrame, errors: ParameterErrors) -> tuple[str, ...]:
    """Return remarks on cases in which errors of the hull may appear as velocity of the water."""
    remarks = []
    if not errors.calibrated:
        remarks.append(
            "the platform file states no errors of a calibration, so each parameter of the hull counts with its "
            "plausible deviation: calibrate the hull (gliderhpc calibrate) and run the mission with the file that it "
            "writes"
        )
    mean, error = _mean_difference(table)
    expected = median_of(table, "difference_std")
    if abs(mean) > _DOUBTFUL * np.hypot(error, expected):
        remarks.append(
            f"dives and climbs differ by {100 * mean:+.2f} cm/s, more than errors of {100 * error:.2f} (scatter) and "
            f"{100 * expected:.2f} cm/s (hull) explain: the hull's parameters or the pitch sensor are in error"
        )
    return tuple(remarks)


def _leg_comparison(table: pd.DataFrame, leg: str, whose: str) -> Comparison:
    deviation = median_of(table, leg_column("mean_std", leg))
    return Comparison(
        f"mean vertical velocity of the water, {leg}s",
        "m/s",
        median_of(table, leg_column("mean", leg)),
        spread=_quartiles(table, leg_column("mean", leg)),
        remark=f"standard deviation {deviation:.4f} m/s by {whose}",
    )


def _differences(table: pd.DataFrame, whose: str) -> tuple[Comparison, ...]:
    if "difference" not in table:
        return ()
    mean, error = _mean_difference(table)
    known = counted(int(table["difference"].notna().sum()), "profile")
    return (
        Comparison("dives minus climbs at the same depths, mean", "m/s", mean,
                   remark=f"{error:.4f} m/s by the scatter of {known}"),
        Comparison("its standard deviation as expected", "m/s", median_of(table, "difference_std"),
                   remark=f"by {whose}; users require {TARGET_ERROR:g}"),
        Comparison("dives minus climbs, root mean square over levels", "m/s", median_of(table, "difference_rms")),
    )  # fmt: skip


def _parameter_comparison(table: pd.DataFrame, name: str, leg: str) -> Comparison:
    return Comparison(
        f"change for one plausible deviation of {name}, {leg}s",
        "m/s",
        median_of(table, effect_column(name, leg)),
        spread=_quartiles(table, effect_column(name, leg)),
    )


def _against_truth(table: pd.DataFrame) -> tuple[Comparison, ...]:
    if "error_rms" not in table:
        return ()
    return (
        Comparison("against the truth, root mean square", "m/s", median_of(table, "error_rms")),
        Comparison("against the truth, mean", "m/s", median_of(table, "error_mean")),
        Comparison("error over its stated deviation, root mean square", "1", median_of(table, "error_normalised")),
        Comparison("correlation with the truth", "1", median_of(table, "truth_correlation")),
    )


def _mean_difference(table: pd.DataFrame) -> tuple[float, float]:
    """Return the mean of dives minus climbs over the profiles, and its standard error by scatter (NaN for one)."""
    if "difference" not in table:
        return float("nan"), float("nan")
    values = table["difference"].dropna().to_numpy()
    error = float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else float("nan")
    return (float(values.mean()) if len(values) else float("nan")), error


def _quartiles(table: pd.DataFrame, name: str) -> tuple[float, float] | None:
    if name not in table:
        return None
    low, high = table[name].quantile([0.25, 0.75]).tolist()
    return float(low), float(high)


def show(archive: Archive) -> Findings:
    """Show the study of an archive."""
    provenance, table = provenance_of(archive, NAME), study_table(archive, NAME)
    failed, known = failed_profiles(table)
    by_density = any(uses_measured_density(archive, number) for number in provenance.profiles)
    errors = hull_errors(platform_of(archive), by_density=by_density)
    facts = {
        "profiles": list(provenance.profiles),
        "quick": provenance.quick,
        "hull_errors": "of the calibration" if errors.calibrated else "plausible deviations",
        "medians": column_medians(known),
    }
    return archive_findings(
        NAME,
        comparisons=comparisons(known, errors),
        tables={"profiles": table},
        figures={"vertical": partial(vertical_figure, archive, known)},
        facts=facts,
        failed=failed,
        remarks=provenance.remarks + remarks_on(known, errors),
        captions=_captions(provenance, known, errors, by_density=by_density),
    )


def _captions(
    provenance: Provenance, known: pd.DataFrame, errors: ParameterErrors, *, by_density: bool
) -> dict[str, str]:
    """Return the captions of figure and table: their data, and the effect of the hull's errors."""
    data = describe_data(provenance, known["profile"].tolist())
    buoyancy = "by measured density" if by_density else "by its depth slope"
    window, share = float(known["window"].median()), float(known["share"].median())
    whose = "as its calibration states them" if errors.calibrated else "plausible ones, as no calibration states them"
    deviations = [
        float(known[name].median()) for name in [leg_column("mean_std", leg) for leg in PHASES] if name in known
    ]
    sure = (
        f"Deviations include the depth sensor's noise, rounded pitch and errors of the hull's parameters ({whose}): "
        f"the latter shift the mean of a leg by {100.0 * max(deviations, default=float('nan')):.2g} cm/s (median)."
    )
    return {
        "vertical": (
            "Upward velocity of the water: depth rate of the hull's glide in still water minus the measured one, with "
            f"its buoyancy {buoyancy}, over windows of {window:.0f} s. Panels (a) and (b): profile "
            f"{int(known['profile'].iloc[0])}; (c) and (d): {data}. {sure}"
        ),
        "profiles": (
            f"One row per profile: {data}; {share:.0%} of the samples have a velocity (median), the others lie in the "
            f"vibration set, in gaps or near the surface. Dives minus climbs are taken at the same {LEVELS} levels, "
            f"where a velocity of the water that is the same on both cancels. {sure}"
        ),
    }
