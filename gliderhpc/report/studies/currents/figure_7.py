"""Figure 7 of the paper for any profile: the current by depth over its depth-averaged baseline, and along the track."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.findings.drawing import (
    ESTIMATE,
    FILTER,
    LANDSCAPE,
    SMALL,
    TRUTH,
    footnote,
    label,
    legend,
    nothing_here,
    panels,
)
from gliderhpc.platform import Platform
from gliderhpc.studies.archived import mission_of, platform_of
from gliderhpc.studies.currents.passband import Passband, passband, unseen, unseen_in_bins
from gliderhpc.studies.currents.settings import DepthResolvedSettings
from gliderhpc.studies.library.anchored_track import anchored_tracks
from gliderhpc.studies.library.profile_reconstruction import motions_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_COLOURS = {"north": ESTIMATE, "east": FILTER}
_VECTORS = 40
"""Shear vectors along the track."""

_LONGEST = 0.2
"""Length of the longest of them, in widths of the panel."""


def figure_7(archive: xr.DataTree, data: ProfileData, settings: DepthResolvedSettings) -> Figure:
    """Draw the binned current with its 2-sigma band, the shear-sensitive part alone, and the track with its vectors.

    What vertical scales the settings and the way the hull flew cannot show is written below.
    """
    study = archive["currents"].to_dataset().sel(profile=data.number).load()
    title = f"Depth-resolved current of profile {data.number}: {mission_of(archive)}"
    figure, (left, middle, right) = panels(1, 3, LANDSCAPE, title)
    _draw_track(right, archive, data, study)
    label(left, "current by depth, 2-sigma band", "m/s", "m")
    label(middle, "shear-sensitive part, limits to scale", "mm/s", "m")
    if not np.isfinite(study["both_shear_north"]).any():
        for axes in (left, middle):
            nothing_here(axes, nothing_retrieved(study))
        return figure
    _draw_profile(left, study)
    _draw_shear(middle, data, study)
    band = _passband(data, platform_of(archive), settings)
    _draw_limits(middle, band)
    footnote(figure, f"{unseen(band)}\n{unseen_in_bins(band)}")
    return figure


def nothing_retrieved(study: xr.Dataset) -> str:
    """Say why a profile has no depth-resolved current: its message, or what became of its samples."""
    message = str(study["message"].values)
    if message:
        return message
    counts = {
        "without a root": study["rootless"], "with a condition number beyond the limit": study["ill_conditioned"],
        "in stretches too short to smooth": study["interrupted"],
    }  # fmt: skip
    lost = [f"{int(count)} {why}" for why, count in counts.items() if np.isfinite(count) and count > 0]
    samples = ", ".join(lost) if lost else "none is in steady glide"
    return f"no depth-resolved current: of the profile's samples {samples}"


def _draw_profile(axes: Axes, study: xr.Dataset) -> None:
    depth = study["bin_depth"].values
    for along, colour in _COLOURS.items():
        base = float(study[f"current_{along}"])
        base = base if np.isfinite(base) else 0.0
        mean = base + study[f"both_shear_{along}"].values
        noise = np.nan_to_num(study[f"both_shear_noise_std_{along}"].values)
        deviation = np.hypot(study[f"both_shear_coefficient_std_{along}"].values, noise)
        axes.axvline(base, color=colour, linewidth=0.8, linestyle="--", label=f"depth-averaged, {along}")
        axes.plot(mean, depth, color=colour, linewidth=1.0, label=f"depth-averaged + shear-sensitive, {along}")
        axes.fill_betweenx(depth, mean - 2 * deviation, mean + 2 * deviation, color=colour, alpha=0.2, linewidth=0)
        if np.isfinite(study[f"reference_by_depth_{along}"]).any():
            axes.plot(study[f"reference_by_depth_{along}"], depth, ":", color=colour, label=f"reference, {along}")
    axes.invert_yaxis()
    legend(axes, "lower right")


def _draw_shear(axes: Axes, data: ProfileData, study: xr.Dataset) -> None:
    depth = data.measured[:, 3]
    for along, colour in _COLOURS.items():
        records = 1000.0 * study[f"shear_{along}"].values[: len(depth)]
        axes.plot(records, depth, ",", color=colour, alpha=0.3)
        for phase, style in (("dive", "-"), ("climb", ":")):
            binned = 1000.0 * study[f"{phase}_shear_{along}"].values
            axes.plot(binned, study["bin_depth"], style, color=colour, linewidth=1.0, label=f"{phase}, {along}")
    axes.invert_yaxis()
    legend(axes, "lower right")


def _passband(data: ProfileData, platform: Platform, settings: DepthResolvedSettings) -> Passband:
    """How scales came through, at the profile's median speeds in steady glide."""
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
    """Draw the longest and the shortest vertical scale that show, to scale, at the panel's right."""
    low, high = axes.get_ylim()
    middle = 0.5 * (low + high)
    for place, scale in ((0.97, band.baseline_limit), (0.87, band.smoothing_limit)):
        axes.plot([place, place], [middle - 0.5 * scale, middle + 0.5 * scale], color=TRUTH, linewidth=2.5,
                  solid_capstyle="butt", transform=axes.get_yaxis_transform())  # fmt: skip
        axes.text(place, middle - scale, f"{scale:.2g} m", transform=axes.get_yaxis_transform(), fontsize=SMALL,
                  ha="center", va="bottom")  # fmt: skip
    axes.set_ylim(low, high)


def _draw_track(axes: Axes, archive: xr.DataTree, data: ProfileData, study: xr.Dataset) -> None:
    motions = motions_of(data, platform_of(archive))
    tracks = anchored_tracks(archive, data, motions.estimate, motions.glide_angle)
    track = data.motion[:, :2] if tracks is None else tracks.estimate
    where = "through the water: no fix on either side" if tracks is None else "over the ground"
    axes.plot(track[:, 1], track[:, 0], color=ESTIMATE, linewidth=1.0, label=f"track {where}")
    if tracks is not None:
        axes.plot(tracks.fixes[:, 1], tracks.fixes[:, 0], "^", color=TRUTH, markersize=5, label="GPS fix")
    shear = np.column_stack([study[f"shear_{along}"].values[: len(track)] for along in ("north", "east")])
    known = np.flatnonzero(np.isfinite(shear).all(axis=1))
    if known.size:
        rows = known[np.linspace(0, known.size - 1, min(_VECTORS, known.size)).astype(np.int64)]
        longest = float(np.max(np.hypot(*shear[rows].T)))
        # Left to itself the scale follows the mean, and one strong vector leaves the panel.
        arrows = axes.quiver(
            track[rows, 1], track[rows, 0], shear[rows, 1], shear[rows, 0], color=FILTER, width=0.004, angles="xy",
            scale=max(longest, 1e-9) / _LONGEST, scale_units="width",
        )  # fmt: skip
        shown = float(f"{longest:.1g}")
        axes.quiverkey(arrows, 0.8, 0.03, shown, f"{1000 * shown:g} mm/s", labelpos="N", fontproperties={"size": SMALL})
    axes.set_aspect("equal", adjustable="datalim")
    label(axes, "track with shear vectors", "east of the entry fix, m", "north of the entry fix, m")
    legend(axes)
