"""Study ``currents``: table, comparisons, Figure 7 and captions, from its group of an archive alone."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.archive.profile import ProfileData, read_profile_data
from gliderhpc.archive.reader import Archive
from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.drawing import (
    ESTIMATE,
    FILTER,
    LANDSCAPE,
    SMALL,
    TRUTH,
    footnote,
    label,
    legend,
    mark_empty,
    panels,
)
from gliderhpc.findings.formatting import number
from gliderhpc.findings.results import Findings, archive_findings
from gliderhpc.platform import Platform
from gliderhpc.report.studies.summaries import describe_data, estimate_label, median_of, shared_facts
from gliderhpc.store_schema.columns import bin_column, component_column
from gliderhpc.studies.archived import (
    Provenance,
    column_medians,
    failed_profiles,
    mission_of,
    platform_of,
    provenance_of,
    study_table,
)
from gliderhpc.studies.currents import NAME
from gliderhpc.studies.library.passband import Passband, describe_bin_averaging, describe_unresolved, passband
from gliderhpc.studies.library.retrieval import DepthResolvedSettings
from gliderhpc.studies.library.scores import COVERAGE
from gliderhpc.studies.library.tracks import anchored_tracks, motions_of
from gliderhpc.wording import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = {"north": ESTIMATE, "east": FILTER}
_VECTORS = 40
"""Maximum number of shear vectors along the track."""

_VECTOR_LENGTH = 0.2
"""Length of the longest shear vector, relative to the width of the panel."""


_TERMS = {
    "axial_std": "axial speed",
    "heading_std": "compass",
    "fix_std": "fixes",
    "actuation_std": "actuation",
}
"""Errors whose terms are columns of the table."""


def figure_7(archive: Archive, data: ProfileData, settings: DepthResolvedSettings) -> Figure:
    """Draw the binned current with its 2-sigma band, the shear-sensitive part alone, and the track with its vectors.

    A note below the panels names the vertical scales removed by the settings and by the hull's motion.
    """
    study = archive["currents"].to_dataset().sel(profile=data.number).load()
    title = f"Depth-resolved current of profile {data.number}: {mission_of(archive)}"
    figure, (left, middle, right) = panels(1, 3, LANDSCAPE, title)
    _draw_track(right, archive, data, study)
    label(left, "current by depth, 2-sigma band", "m/s", "m")
    label(middle, "shear-sensitive part, limits to scale", "mm/s", "m")
    if not np.isfinite(study["both_shear_north"]).any():
        for axes in (left, middle):
            mark_empty(axes, nothing_retrieved(study))
        return figure
    _draw_profile(left, study)
    _draw_shear(middle, data, study)
    band = _passband(data, platform_of(archive), settings)
    _draw_limits(middle, band)
    footnote(figure, f"{describe_unresolved(band)}\n{describe_bin_averaging(band)}")
    return figure


def _figure_7_of(archive: Archive, number: int, estimate: str, settings: DepthResolvedSettings) -> Figure:
    return figure_7(archive, read_profile_data(archive, number, estimate), settings)


def nothing_retrieved(study: xr.Dataset) -> str:
    """Describe why a profile has no depth-resolved current: its message, or the reasons why samples were masked."""
    message = str(study["message"].values)
    if message:
        return message
    counts = {
        "without a root": study["rootless"],
        "with a condition number beyond the limit": study["ill_conditioned"],
        "in stretches too short to smooth": study["interrupted"],
    }
    lost = [f"{int(count)} {why}" for why, count in counts.items() if np.isfinite(count) and count > 0]
    samples = ", ".join(lost) if lost else "none in steady glide"
    return f"no depth-resolved current; samples of the profile: {samples}"


def _draw_profile(axes: Axes, study: xr.Dataset) -> None:
    depth = study["bin_depth"].values
    for along, colour in _COLOURS.items():
        base, what = float(study[component_column("current", along)]), "depth-averaged + shear-sensitive"
        if np.isfinite(base):
            axes.axvline(base, color=colour, linewidth=0.8, linestyle="--", label=f"depth-averaged, {along}")
        else:
            base, what = 0.0, "shear-sensitive part"
        mean = base + study[component_column(bin_column("both", "shear"), along)].values
        noise = np.nan_to_num(study[component_column(bin_column("both", "shear_noise_std"), along)].values)
        deviation = np.hypot(study[component_column(bin_column("both", "shear_coefficient_std"), along)].values, noise)
        axes.plot(mean, depth, color=colour, linewidth=1.0, label=f"{what}, {along}")
        axes.fill_betweenx(depth, mean - 2 * deviation, mean + 2 * deviation, color=colour, alpha=0.2, linewidth=0)
        reference = study[component_column("reference_by_depth", along)]
        if np.isfinite(reference).any():
            axes.plot(reference, depth, ":", color=colour, label=f"reference, {along}")
    axes.locator_params(axis="x", nbins=5)
    axes.invert_yaxis()
    legend(axes, "lower right")


def _draw_shear(axes: Axes, data: ProfileData, study: xr.Dataset) -> None:
    depth = data.measured[:, 3]
    for along, colour in _COLOURS.items():
        records = 1000.0 * study[component_column("shear", along)].values[: len(depth)]
        axes.plot(records, depth, ",", color=colour, alpha=0.3)
        for phase, style in (("dive", "-"), ("climb", ":")):
            binned = 1000.0 * study[component_column(bin_column(phase, "shear"), along)].values
            axes.plot(binned, study["bin_depth"], style, color=colour, linewidth=1.0, label=f"{phase}, {along}")
    axes.invert_yaxis()
    legend(axes, "lower right")


def _passband(data: ProfileData, platform: Platform, settings: DepthResolvedSettings) -> Passband:
    """Return the passband at the profile's median speeds in steady glide."""
    steady = data.steady_records
    if not steady.any():
        steady = np.ones_like(steady)
    depth_rate = np.gradient(data.reconstructed[:, 3], data.record_time)
    return passband(
        platform,
        speed=float(np.nanmedian(np.linalg.norm(data.motion[steady, 2:5], axis=1))),
        vertical_speed=float(np.nanmedian(np.abs(depth_rate[steady]))),
        step=data.step,
        settings=settings,
    )


def _draw_limits(axes: Axes, band: Passband) -> None:
    """Draw the longest and the shortest resolved vertical scale, to scale, at the right of the panel."""
    low, high = axes.get_ylim()
    middle = 0.5 * (low + high)
    for x, scale in ((0.97, band.baseline_limit), (0.87, band.smoothing_limit)):
        axes.plot(
            [x, x],
            [middle - 0.5 * scale, middle + 0.5 * scale],
            color=TRUTH,
            linewidth=2.5,
            solid_capstyle="butt",
            transform=axes.get_yaxis_transform(),
        )
        axes.text(
            x,
            middle - scale,
            f"{scale:.2g} m",
            transform=axes.get_yaxis_transform(),
            fontsize=SMALL,
            ha="center",
            va="bottom",
        )
    axes.set_ylim(low, high)


def _draw_track(axes: Axes, archive: Archive, data: ProfileData, study: xr.Dataset) -> None:
    motions = motions_of(data, platform_of(archive))
    tracks = anchored_tracks(archive, data, motions.estimate, motions.glide_angle)
    track = data.motion[:, :2] if tracks is None else tracks.estimate
    where = "through the water: a fix is missing" if tracks is None else "over the ground"
    axes.plot(track[:, 1], track[:, 0], color=ESTIMATE, linewidth=1.0, label=f"track {where}")
    if tracks is not None:
        axes.plot(tracks.fixes[:, 1], tracks.fixes[:, 0], "^", color=TRUTH, markersize=5, label="GPS fix")
    shear = np.column_stack(
        [study[component_column("shear", along)].values[: len(track)] for along in ("north", "east")]
    )
    known = np.flatnonzero(np.isfinite(shear).all(axis=1))
    if known.size:
        rows = known[np.linspace(0, known.size - 1, min(_VECTORS, known.size)).astype(np.int64)]
        longest = float(np.max(np.hypot(*shear[rows].T)))
        # By default the scale depends on the mean, and one strong vector would leave the panel.
        arrows = axes.quiver(
            track[rows, 1],
            track[rows, 0],
            shear[rows, 1],
            shear[rows, 0],
            color=FILTER,
            width=0.004,
            angles="xy",
            scale=max(longest, 1e-9) / _VECTOR_LENGTH,
            scale_units="width",
        )
        shown = float(f"{longest:.1g}")
        axes.quiverkey(arrows, 0.8, 0.03, shown, f"{1000 * shown:g} mm/s", labelpos="N", fontproperties={"size": SMALL})
    axes.set_aspect("equal", adjustable="datalim")
    origin = "start" if tracks is None else "entry fix"
    label(axes, "track with shear vectors", f"east of the {origin}, m", f"north of the {origin}, m")
    legend(axes)


def captions(
    provenance: Provenance, table: pd.DataFrame, settings: DepthResolvedSettings, drawn: Mapping[str, int]
) -> dict[str, str]:
    """Return the captions of the table and of the figures, by stem."""
    figures = {
        stem: _figure_caption(provenance, table[table["profile"] == profile].iloc[0], settings)
        for stem, profile in drawn.items()
    }
    return {"currents": _table_caption(provenance, table)} | figures


def _table_caption(provenance: Provenance, table: pd.DataFrame) -> str:
    known = int(table["current_north"].notna().sum())
    text = (
        f"Depth-averaged current from the fixes and the self-motion of {estimate_label(provenance)}, with every term "
        f"of its uncertainty, and a summary of the depth-resolved current: {describe_data(provenance)}, {known} of "
        "them with a current. "
    )
    if "ellipse_major" not in table:
        return text + "Without a fix before and after the dive there is no ellipse."
    major, minor = (number(float(table[f"ellipse_{axis}"].median())) for axis in ("major", "minor"))
    return (
        f"{text}One-sigma ellipses, which contain {COVERAGE[1]:.0%} of normally distributed errors; median semi-axes "
        f"{major} and {minor} m/s. They include {_errors_included(table)}, but no other error that all profiles share."
    )


def _errors_included(table: pd.DataFrame) -> str:
    """Name the errors that the ellipses contain: terms of a run with the hull's errors are zero."""
    names = [name for column, name in _TERMS.items() if (table[column] > 0.0).any()]
    hull = [] if _TERMS["axial_std"] in names else ["the hull's errors with those of the compass"]
    listed = " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)
    return " and ".join(hull + ([f"assumed errors of {listed}"] if names else []))


def _figure_caption(provenance: Provenance, row: pd.Series, settings: DepthResolvedSettings) -> str:
    noise = bool(np.isfinite(row["significant_fraction"]))
    hull = f"moment coefficients in error by up to {settings.coefficient_error:.0%} ({settings.draws} draws)"
    known = f"{hull} and the noise of the yaw moment" if noise else f"{hull}; the yaw moment's noise is not known"
    share = number(float(row["coefficient_share"]))
    mean = ", plus the depth-averaged current (dashed)" if np.isfinite(row["current_north"]) else ""
    return (
        f"Profile {int(row['profile'])}: current by depth (eq. 41), from the yaw moment of "
        f"{estimate_label(provenance)} minus its moving average over {settings.baseline:g} s, smoothed over "
        f"{settings.smoothing:g} s, in bins of {settings.bin:g} m{mean}. Bands are two sigma from {known}; errors of "
        f"the coefficients alone give a relative scatter of the lateral current of {share}. It is a lower bound: the "
        "hull follows slow changes of the current, and the vertical scales named below the panels are not resolved."
    )


_MEDIANS = (
    ("reference_difference", "m/s", "vector difference from the reference's depth-averaged current, median"),
    ("reference_correlation", "1", "correlation of the lateral current by depth with the reference's, median"),
    ("reference_gradient_correlation", "1", "its correlation with the reference's vertical gradient"),
)


def reference_rows(table: pd.DataFrame) -> tuple[Comparison, ...]:
    """Return the comparisons with a reference, if there is one; the paper has no counterpart."""
    medians = [
        Comparison(quantity, unit, float(table[name].median()))
        for name, unit, quantity in _MEDIANS
        if name in table and table[name].notna().any()
    ]
    if "reference_distance" not in table:
        return tuple(medians)
    distance = table["reference_distance"].dropna()
    shares = [
        Comparison(
            f"reference within {sigma} sigma, share of profiles",
            "1",
            float((distance <= sigma).mean()),
            remark=f"{int((distance <= sigma).sum())} of {len(distance)}; {expected:.2f} if both errors are "
            "independent and normal",
        )
        for sigma, expected in COVERAGE.items()
    ]
    return (*medians, *shares)


DRAWN = 3
"""Number of profiles with a figure."""

PAPER_COEFFICIENT_SHARE, PAPER_ABSOLUTE_SHARE = 0.30, 0.015
"""Relative effect of 15 % errors of the moment coefficients on shear and absolute current, from the paper."""


def show(archive: Archive) -> Findings:
    """Show the study of an archive."""
    provenance, table = provenance_of(archive, NAME), study_table(archive, NAME)
    settings = DepthResolvedSettings.model_validate(provenance.settings)
    refused, retrieved = failed_profiles(table)
    remarks = provenance.remarks
    if refused:
        remarks = (*remarks, f"{len(refused)} of {counted(len(table), 'profile')}: {next(iter(refused.values()))}")
    facts = shared_facts(provenance) | {"settings": settings.model_dump(), "medians": column_medians(table)}
    drawn = {f"figure_7_profile_{number}": number for number in retrieved["profile"][:DRAWN].tolist()}
    figures = {
        stem: partial(_figure_7_of, archive, number, provenance.estimate, settings) for stem, number in drawn.items()
    }
    return archive_findings(
        NAME,
        comparisons=_comparisons(table),
        tables={"currents": table},
        figures=figures,
        facts=facts,
        failed={},
        remarks=remarks,
        captions=captions(provenance, table, settings, drawn),
    )


def _comparisons(table: pd.DataFrame) -> tuple[Comparison, ...]:
    return (
        Comparison("speed of the depth-averaged current, median", "m/s", median_of(table, "speed"), (0.04, 0.42)),
        Comparison("longer semi-axis of the 1-sigma ellipse, median", "m/s", median_of(table, "ellipse_major")),
        Comparison("shorter semi-axis of the 1-sigma ellipse, median", "m/s", median_of(table, "ellipse_minor")),
        Comparison(
            "lateral current, root mean square, median", "m/s", median_of(table, "shear_rms"),
            remark="shear-sensitive part, a lower bound: the hull follows slow changes",
        ),
        Comparison(
            "its relative scatter by errors of the moment coefficients (paper: 15 %)", "1",
            median_of(table, "coefficient_share"), PAPER_COEFFICIENT_SHARE,
        ),
        Comparison(
            "the same over the absolute current", "1", median_of(table, "coefficient_share_absolute"),
            PAPER_ABSOLUTE_SHARE, paper_text="< 0.015",
        ),
        Comparison("share of records beyond twice the noise floor", "1", median_of(table, "significant_fraction")),
        Comparison("share of the steady glide with a lateral current", "1", median_of(table, "retrieved_fraction")),
        *reference_rows(table),
    )  # fmt: skip
