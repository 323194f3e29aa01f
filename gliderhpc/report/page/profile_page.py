"""Page of one profile: motion, disturbances, windows, controls, currents, and its row of the archive."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.archive.current import adopted_current
from gliderhpc.archive.mission import platform_name
from gliderhpc.archive.profile import ADJOINT, SMOOTHED, ProfileData, done_profiles, read_profile_data
from gliderhpc.archive.reader import Archive
from gliderhpc.findings.formatting import instant
from gliderhpc.observations.truth import read_profile_truth
from gliderhpc.outcomes import Outcome
from gliderhpc.report.facts import facts_of
from gliderhpc.report.motion_figure import motion_figure
from gliderhpc.report.page.content import (
    Block,
    Commands,
    FigureBlock,
    Notice,
    Page,
    PageSection,
    Paragraph,
    Table,
    heading,
)
from gliderhpc.report.page.profile_figures import (
    controls_figure,
    track_figure,
    vibration_rows,
    window_rows,
    windows_figure,
    windows_of,
)
from gliderhpc.report.page.rendering import cell
from gliderhpc.report.page.reproduction import provenance_section, study_command
from gliderhpc.report.studies import studies_in
from gliderhpc.report.studies.currents import figure_7, nothing_retrieved
from gliderhpc.store_schema.location import Location
from gliderhpc.studies.archived import outdated_because, provenance_of
from gliderhpc.studies.library.retrieval import DepthResolvedSettings
from gliderhpc.vocabulary import QUALITY


def profile_page(archive: Archive, number: int, place: Location, command: str, truth: Path | None) -> Page:
    """Assemble the page of an estimated profile, compared with `truth` if that of a synthetic mission is passed.

    Raises
    ------
    InputError
        There is no such profile, or it is not done.
    """
    data = read_profile_data(archive, number)
    stem = f"profile_{number}"
    attributes = data.attributes
    return Page(
        f"Profile {number} of {attributes.get('mission') or 'mission'}",
        f"{platform_name(attributes)}, {instant(data.epoch)}",
        (
            _overview(archive, data, stem),
            PageSection("motion", "Motion and disturbances", (motion_block(archive, number, f"{stem}_motion", truth),)),
            PageSection("windows", "Windows of the inversion", _windows(archive, data, stem)),
            PageSection("controls", "Controls and vibration", _controls(data, stem)),
            PageSection("currents", "Currents", _currents(archive, data, place, stem)),
            provenance_section(archive, place, command),
        ),
    )


def _overview(archive: Archive, data: ProfileData, stem: str) -> PageSection:
    """Assemble the results, the message, the quality of the samples, and the row of the archive's table."""
    blocks: list[Block] = [Paragraph(line + ".") for line in facts_of(data, None)]
    message = str(data.table["message"])
    if message:
        blocks.append(Notice(message))
    blocks.append(Table(f"{stem}_quality", "Share of the samples with each quality flag.", _quality_rows(data)))
    blocks.append(Table(f"{stem}_row", "Row of the profile in the archive's table.", _row(archive, data.number)))
    return PageSection("profile", "The profile and its row in the archive", tuple(blocks))


def _row(archive: Archive, number: int) -> list[dict[str, Any]]:
    """Return one row for every column of the archive's table, with unit and meaning."""
    row = archive.to_dataset().sel(profile=number).load()
    return [
        {
            "column": str(name),
            "value": format_value(variable),
            "unit": str(variable.attrs.get("units", "1" if variable.dtype.kind in "fiu" else "")),
            "meaning": str(variable.attrs.get("long_name", "")),
        }
        for name, variable in row.data_vars.items()
    ]


def format_value(variable: xr.DataArray) -> str:
    """Format a value; a flag is shown by its meaning."""
    value, meanings = variable.values[()], variable.attrs.get("flag_meanings")
    if meanings is None or not np.isfinite(value):
        return cell(value, str(variable.name))
    texts = dict(zip(np.ravel(variable.attrs["flag_values"]).tolist(), str(meanings).split(), strict=True))
    return str(texts[int(value)]).replace("_", " ")


def _quality_rows(data: ProfileData) -> list[dict[str, Any]]:
    return [
        {"quality": meaning.replace("_", " "), "share of the samples, %": 100.0 * float(data.flagged(meaning).mean())}
        for meaning in QUALITY.meanings
    ]


def _windows(archive: Archive, data: ProfileData, stem: str) -> tuple[Block, ...]:
    windows = windows_of(archive, data)
    if windows.empty:
        return (Notice("the archive contains no window of this profile"),)
    caption = (
        "Iterations, final cost and optimality measure of every window of the inversion, drawn at the middle of the "
        f"window and marked by outcome. {_describe_outcomes(windows)}"
    )
    alternative = (
        "Iterations, cost and optimality measure of every window over the time of the profile, marked by outcome."
    )
    return (
        FigureBlock(f"{stem}_windows", caption, alternative, windows_figure(data, windows)),
        Table(
            f"{stem}_windows", "The windows; times are counted from the profile's first sample.", window_rows(windows)
        ),
    )


def _describe_outcomes(windows: pd.DataFrame) -> str:
    counts = {outcome: int((windows["outcome"] == outcome).sum()) for outcome in Outcome}
    return " ".join(
        f"{outcome.label.capitalize()} ({outcome.sentence}): {count} of {len(windows)}."
        for outcome, count in counts.items()
        if count
    )


def _controls(data: ProfileData, stem: str) -> tuple[Block, ...]:
    caption = (
        "Recorded controls. Grey: the vibration set, where the battery or the ballast moves faster than the hull's "
        "thresholds, with the guard time on either side; these samples are inverted like the others, but excluded "
        "from the statistics of steady glide."
    )
    alternative = "Battery position and rotation, ballast volume and rudder over time, with the vibration set shaded."
    figure = FigureBlock(f"{stem}_controls", caption, alternative, controls_figure(data))
    return (figure, Table(f"{stem}_vibration", "Intervals of the vibration set.", vibration_rows(data)))


def _currents(archive: Archive, data: ProfileData, place: Location, stem: str) -> tuple[Block, ...]:
    caption = (
        "Tracks under the identified disturbances: through the water and, with the residual drift distributed so that "
        "the track ends on the fixes, over the ground; the arrow is the adopted depth-averaged current. For "
        "comparison, the track from the glide angle, without disturbances. The tracks over the ground meet the exit "
        "fix by construction, so this validates neither; their separation in between shows how far the two "
        "displacements through the water differ."
    )
    blocks: list[Block] = [
        Table(
            f"{stem}_currents",
            "Depth-averaged current by method, with one standard deviation where it is "
            "known; reports and exports adopt the smoother's wherever it is usable.",
            _current_rows(data),
        ),
        FigureBlock(
            f"{stem}_track",
            caption,
            f"Track of profile {data.number} from above, with fixes and current.",
            track_figure(archive, data),
        ),
    ]
    return (*blocks, *depth_resolved_blocks(archive, data.number, place, stem))


def _current_rows(data: ProfileData) -> list[dict[str, Any]]:
    methods = {"smoother": "_smoothed", "inversion": "", "glide angle": "_glide_angle"}
    adopted = {SMOOTHED: "smoother", ADJOINT: "inversion"}.get(str(adopted_current(data.table).estimate))
    rows = []
    for method, suffix in methods.items():
        row: dict[str, Any] = {"method": method, "taken": "yes" if method == adopted else ""}
        for along in ("north", "east"):
            row[f"{along}, m/s"] = _table_value(data, f"dac_{along}{suffix}")
            row[f"{along} std, m/s"] = _table_value(data, f"dac_{along}{suffix}_std")
        rows.append(row)
    return rows


def _table_value(data: ProfileData, name: str) -> float:
    return float(data.table.get(name, np.nan))


_MOTION_CAPTION = (
    "Top: measured attitude and depth, and those of the model under the adjoint's disturbances; the residual is that "
    "in steady glide. Below: the three forces and three moments of the water not explained by the hull's "
    "coefficients, from the adjoint (windows, the primary estimate), the extended Kalman filter and the smoother. "
    "Bands are one standard deviation on either side. The smoother's includes the uncertainty of prior and sensors "
    "and, where it was computed, that of the hull's parameters; the adjoint's also the difference from the smoother; "
    "axial and heave force are only weakly observed. Grey: actuators moving."
)


_WITH_TRUTH = " Dashed: the truth of this synthetic mission; errors relative to it are those in steady glide."


def representative_section(archive: Archive, command: str, truth: Path | None) -> PageSection | None:
    """Return a section on the profile of median depth, None without any; `truth` is that of a synthetic mission."""
    number = representative_profile(archive)
    if number is None:
        return None
    introduction = Paragraph(
        f"Profile {number}, of median depth among the estimated profiles, serves as an example (as in the "
        "paper's Figures 2 and 3)."
    )
    figure = motion_block(archive, number, "representative_profile", truth)
    other = Commands("To write the page of any profile, with its windows, controls and currents:", (command,))
    return PageSection("representative", f"A representative profile: {number}", (introduction, figure, other))


def motion_block(archive: Archive, number: int, stem: str, truth: Path | None) -> FigureBlock:
    """Draw a profile's motion and disturbances, with the truth if it is known."""
    known = None if truth is None else read_profile_truth(truth, number)
    return FigureBlock(
        stem,
        f"Profile {number}. {_MOTION_CAPTION}{'' if truth is None else _WITH_TRUTH}",
        _alternative(number),
        motion_figure(archive, number, known),
    )


def representative_profile(archive: Archive) -> int | None:
    """Return the number of the estimated profile of (lower) median depth, None if no profile is done."""
    done = done_profiles(archive)
    if not done:
        return None
    depth = archive.to_dataset()["max_depth"].sel(profile=done).values
    return done[int(np.argsort(depth, kind="stable")[(len(done) - 1) // 2])]


def _alternative(number: int) -> str:
    """Describe the figure for readers who cannot see it."""
    return (
        f"Ten panels over the time of profile {number}: roll, pitch, heading and depth, measured and reconstructed; "
        "then the forces along and the moments about the three axes, by adjoint, filter and smoother."
    )


_CURRENTS = "currents"

_BY_DEPTH_CAPTION = (
    "Depth-resolved current (the paper's Figure 7): the shear-sensitive part inferred from the yaw moment, plus "
    "the depth-averaged current, with two standard deviations from sampled coefficients and identification noise. It "
    "is a lower bound in a band of vertical scales, given below the panels, and not the absolute profile: slow shear "
    "is not observable."
)


def depth_resolved_blocks(archive: Archive, number: int, place: Location, stem: str) -> tuple[Block, ...]:
    """Show Figure 7 and the depth bins of a profile, or the reason why there are none."""
    if _CURRENTS not in studies_in(archive) or number not in provenance_of(archive, _CURRENTS).profiles:
        command = study_command(_CURRENTS, archive, place)
        return (Commands("The archive contains no depth-resolved current of this profile. To compute it:", (command,)),)
    bins = archive[_CURRENTS].to_dataset().sel(profile=number).load()
    provenance = provenance_of(archive, _CURRENTS)
    outdated = outdated_because(archive, _CURRENTS)
    warning = (Notice(f"The depth-resolved current was {outdated}; run the study again."),) if outdated else ()
    if not np.isfinite(bins["both_shear_north"].values).any():
        return (*warning, Notice(nothing_retrieved(bins)))
    figure = figure_7(
        archive,
        read_profile_data(archive, number, provenance.estimate),
        DepthResolvedSettings.model_validate(provenance.settings),
    )
    alternative = (
        f"Current of profile {number} by depth, its shear-sensitive part on dive and climb, and the track from above."
    )
    return (
        *warning,
        FigureBlock(f"{stem}_current_by_depth", _BY_DEPTH_CAPTION, alternative, figure),
        Table(f"{stem}_current_by_depth", "The depth bins that have a value.", _bin_rows(bins)),
    )


def _bin_rows(bins: xr.Dataset) -> list[dict[str, Any]]:
    """Return one row for every depth bin with a value, with all of the study's columns by bin."""
    names = [str(name) for name, variable in bins.data_vars.items() if variable.dims == ("bin",)]
    columns = {heading(bins[name]): bins[name].values for name in names}
    known = np.isfinite(bins["both_shear_north"].values)
    return [{name: values[index].item() for name, values in columns.items()} for index in np.flatnonzero(known)]
