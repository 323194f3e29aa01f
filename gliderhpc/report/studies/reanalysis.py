"""Study ``reanalysis``: Table 4, Figure 8, agreement and captions, from its group of an archive alone."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.archive.reader import Archive
from gliderhpc.findings.drawing import FILTER, MODEL, SHADE, SMALL, SMOOTHER, TRUTH, label, legend, panels
from gliderhpc.findings.formatting import markdown
from gliderhpc.findings.results import Findings, archive_findings
from gliderhpc.report.studies.reanalysis_comparisons import Compared, agreement_rows, agreements, compare, comparisons
from gliderhpc.report.studies.summaries import describe_data, describe_profiles, estimate_label, shared_facts
from gliderhpc.studies.archived import (
    Provenance,
    as_cells,
    failed_profiles,
    mission_of,
    provenance_of,
    stored_attribute,
)
from gliderhpc.studies.library.scores import MIN_COVERAGE, direction, ellipse_axes, speed
from gliderhpc.studies.library.tracks import UncertainCurrent, ellipses_used
from gliderhpc.studies.reanalysis import COUNTS, NAME
from gliderhpc.wording import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

MARKERS = (
    ("*", FILTER, 9.0),
    ("D", SMOOTHER, 5.0),
    ("P", "#CC79A7", 6.0),
    ("X", "#E69F00", 6.0),
    ("v", "#56B4E9", 6.0),
)
"""Shape, colour and size of the models' points, in the order in which the models are given."""

_ROOM = 0.15
_SIDE, _HEAD = 3.2, 0.4


def figure_8(compared: Compared, places: list[int], mission: str) -> Figure:
    """Draw Figure 8: the currents of some profiles, each in a panel.

    Parameters
    ----------
    compared : Compared
        Currents of the glider and of the models (m/s) of every profile.
    places : list of int
        Positions of the profiles in `compared`.
    mission : str
        Name of the mission, for the title.
    """
    across = min(3, len(places))
    down = -(-len(places) // across)
    size = (_SIDE * max(across, 2), _SIDE * down + _HEAD)
    figure, axes = panels(down, across, size, f"Depth-averaged currents and ocean models: {mission}")
    for index, (panel, position) in enumerate(zip(axes, places, strict=False)):
        _draw(panel, compared, position)
        if index == 0:
            legend(panel)
    for unused in axes[len(places) :]:
        unused.set_axis_off()
    return figure


def _draw(axes: Axes, compared: Compared, position: int) -> None:
    current = compared.currents[position]
    _draw_ellipses(axes, current)
    points = [("glide angle", compared.glide_angle[position], ("^", MODEL, 6.0))]
    points += [
        (name, compared.models[position, index], MARKERS[index % len(MARKERS)])
        for index, name in enumerate(compared.names)
    ]
    for name, (north, east), (marker, colour, size) in [
        (compared.estimate, current.velocity, ("s", TRUTH, 5.0)),
        *points,
    ]:
        if np.isfinite(north + east):
            axes.plot(east, north, marker, color=colour, markersize=size, linestyle="none", label=name)
    axes.axhline(0.0, color=SHADE, linewidth=0.5)
    axes.axvline(0.0, color=SHADE, linewidth=0.5)
    _frame(axes, current, np.array([velocity for _, velocity, _ in points]))
    distances = zip(compared.names, compared.distance[position], strict=True)
    text = ", ".join(f"{name} {value:.1f}σ" for name, value in distances if np.isfinite(value))
    axes.text(0.02, 0.02, text, transform=axes.transAxes, fontsize=SMALL, parse_math=False)
    label(axes, f"profile {compared.numbers[position]}, day {compared.days[position]:.0f}", "east (m/s)", "north (m/s)")


def _draw_ellipses(axes: Axes, current: UncertainCurrent) -> None:
    from matplotlib.patches import Ellipse

    north, east = current.velocity
    if not np.isfinite(current.covariance).all():
        return
    longer, shorter, angle = ellipse_axes(current.covariance)
    for sigmas, style in ((1.0, "-"), (2.0, "--")):
        axes.add_patch(
            Ellipse(
                (east, north),
                2.0 * sigmas * longer,
                2.0 * sigmas * shorter,
                angle=angle,
                fill=False,
                color=TRUTH,
                linewidth=0.8,
                linestyle=style,
                label=f"{sigmas:.0f}σ",
            )
        )


def _frame(axes: Axes, current: UncertainCurrent, points: Array) -> None:
    """Set square limits around every point, the 2-sigma ellipse and the origin."""
    reach = 2.0 * np.sqrt(np.nan_to_num(np.diag(current.covariance)))
    corners = np.concatenate([points, [[0.0, 0.0]], [current.velocity - reach, current.velocity + reach]])
    low, high = np.nanmin(corners, axis=0), np.nanmax(corners, axis=0)
    half = (0.5 + _ROOM) * max(float((high - low).max()), 1e-3)
    north, east = 0.5 * (low + high)
    axes.set_xlim(east - half, east + half)
    axes.set_ylim(north - half, north + half)
    axes.set_aspect("equal")


_DIGITS = {"speed": 3, "direction": 0, "distance": 1, "day": 0}
_ABSENT = "–"


def table_4(compared: Compared, places: list[int]) -> list[dict[str, Any]]:
    """Return the rows of Table 4 for some positions: speeds in m/s, directions in degree, distances in sigma."""
    return [_row(compared, position) for position in places]


def table_4_text(rows: list[dict[str, Any]]) -> str:
    """Format the table as text, rounded as in the paper."""
    columns = list(rows[0]) if rows else []
    heading = "Depth-averaged currents: speed (m/s), direction towards (degree), distance of the models (sigma)\n\n"
    cells = [[_cell(name, value) for name, value in row.items()] for row in rows]
    return heading + markdown(columns, cells, columns) + "\n" if rows else "No profile has a current.\n"


def _row(compared: Compared, position: int) -> dict[str, Any]:
    velocities = {
        compared.estimate: compared.glider[position],
        "glide angle": compared.glide_angle[position],
        **dict(zip(compared.names, compared.models[position], strict=True)),
    }
    row: dict[str, Any] = {"profile": int(compared.numbers[position]), "day": float(compared.days[position])}
    for name, velocity in velocities.items():
        row |= {f"{name} speed": float(speed(velocity)), f"{name} direction": float(direction(velocity))}
    distances = zip(compared.names, compared.distance[position], strict=True)
    return row | {f"{name} distance": float(value) for name, value in distances}


def _cell(name: str, value: float) -> str:
    if not np.isfinite(value):
        return _ABSENT
    return f"{value:.{_DIGITS.get(name.rpartition(' ')[2], 0)}f}"


_DISTANCE_NOTE = (
    "The distance is scaled by the glider's own uncertainty alone: motion that a model lacks, or that its grid "
    "smooths, adds to the difference and not to this scale."
)


def captions(provenance: Provenance, compared: Compared, places: list[int], *, by_study: bool) -> dict[str, str]:
    """Return the captions by stem; `places` are the positions of the profiles in Table 4 and Figure 8."""
    data, models = describe_data(provenance), ", ".join(compared.names)
    covered = int(np.isfinite(compared.models.sum(axis=2)).any(axis=1).sum())
    panels = describe_profiles([int(compared.numbers[position]) for position in places])
    ellipse = "of study currents" if by_study else "of the mission's run"
    glider = f"depth-averaged current by {estimate_label(provenance)}"
    return {
        "figure_8": (
            f"The {glider} with its 1- and 2-sigma ellipses ({ellipse}), that from the glide angle, and those of "
            f"{models} averaged over the same dive in time and depth: {panels}. {_DISTANCE_NOTE}"
        ),
        "table_4": (
            f"Speed and direction of every current, and each model's distance in sigma of the {glider} ({ellipse}): "
            f"{panels}. {_DISTANCE_NOTE}"
        ),
        "agreement": (
            "Differences of the currents over the mission, and the share of profiles on which a model lies within 1, "
            f"2 and 3 sigma: {data}, {covered} of them covered by a model. {_DISTANCE_NOTE}"
        ),
        "profiles": (
            f"One row per profile and model ({models}), sampled along the dive: {data}. A model that covers less than "
            f"{MIN_COVERAGE:.0%} of the dive's time has no value; the records that it does not cover are counted by "
            f"reason. {_DISTANCE_NOTE}"
        ),
    }


_OTHER_ELLIPSES = (
    "the ellipses come from the present study currents, the distances from before it was run; run reanalysis again"
)


def show(archive: Archive) -> Findings:
    """Show the study of an archive."""
    provenance = provenance_of(archive, NAME)
    compared = compare(archive, provenance.profiles, provenance.estimate)
    agreed, places = agreements(compared), compared.panels()
    table = _by_model(archive, provenance)
    agreement, nine = agreement_rows(compared, agreed), table_4(compared, places)
    facts = shared_facts(provenance) | {"models": stored_attribute(archive, NAME, "models"), "agreement": agreement}
    stored, present = archive[NAME].attrs, ellipses_used(archive, provenance.estimate)
    by_study = present["ellipses_of_study"]
    # Earlier versions of this program stored no digest.
    other = () if all(stored.get(key, value) == value for key, value in present.items()) else (_OTHER_ELLIPSES,)
    return archive_findings(
        NAME,
        comparisons=comparisons(compared, agreed),
        tables={"table_4": pd.DataFrame(nine), "agreement": pd.DataFrame(agreement), "profiles": table},
        figures={"figure_8": partial(figure_8, compared, places, mission_of(archive))} if places else {},
        facts=facts,
        failed={},
        remarks=(*provenance.remarks, *other, *_left_out(table)),
        captions=captions(provenance, compared, places, by_study=by_study),
        documents={"table_4.md": table_4_text(nine)},
    )


def _by_model(archive: Archive, provenance: Provenance) -> pd.DataFrame:
    """Tabulate the study, one row for each profile and model."""
    group = archive[NAME].to_dataset().sel(profile=list(provenance.profiles)).load()
    names = [str(name) for name in group["model"].values]
    shape = (len(provenance.profiles), len(names))
    columns = {"profile": np.array(provenance.profiles)[:, None], "model": np.array(names, dtype=object)[None]}
    columns |= {
        name: as_cells(group[name].values).reshape(len(provenance.profiles), -1) for name in provenance.columns[1:]
    }
    return pd.DataFrame({name: np.broadcast_to(values, shape).ravel() for name, values in columns.items()})


def _left_out(table: pd.DataFrame) -> list[str]:
    """List failed profiles, and for each model the number of profiles without a value, by the most common reason."""
    failed, sampled = failed_profiles(table)
    remarks = [f"profile {number}: {message}" for number, message in failed.items()]
    for name in dict.fromkeys(sampled["model"]):
        own = sampled[sampled["model"] == name]
        without = own[own["north"].isna()]
        if len(without):
            # The reason is that of most records of a profile.
            reasons = without[list(COUNTS.values())].idxmax(axis=1).tolist()
            reasons = ", ".join(
                f"{reason.replace('_', ' ')} {reasons.count(reason)}" for reason in COUNTS.values() if reason in reasons
            )
            remarks.append(f"{name} has no value for {len(without)} of {counted(len(own), 'profile')}: {reasons}")
    return remarks
