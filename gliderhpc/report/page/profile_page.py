"""A deep look at one profile: motion, disturbances, windows, controls, currents, and its row of the archive."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gliderhpc.archive.profile import ADJOINT, SMOOTHED, ProfileData, read_profile_data
from gliderhpc.archive.taken_current import taken_current
from gliderhpc.outcomes import Outcome
from gliderhpc.report.page.cells import cell
from gliderhpc.report.page.content import Block, Grid, Notice, Page, Picture, Section, Words
from gliderhpc.report.page.profile_currents import depth_resolved_blocks
from gliderhpc.report.page.profile_figures import controls_figure, track_figure, vibration_rows
from gliderhpc.report.page.provenance import provenance_section
from gliderhpc.report.page.representative import motion_picture
from gliderhpc.report.page.window_figures import Windows, window_rows, windows_figure, windows_of
from gliderhpc.report.profile_heading import facts_of, instant, platform_name
from gliderhpc.store_schema.place import Place
from gliderhpc.vocabulary import QUALITY


def profile_page(archive: xr.DataTree, number: int, place: Place, command: str, truth: Path | None) -> Page:
    """Everything about a profile that is done, beside the truth where it is of a synthetic mission.

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
            Section("motion", "Motion and disturbances", (motion_picture(archive, number, f"{stem}_motion", truth),)),
            Section("windows", "Windows of the inversion", _windows(archive, data, stem)),
            Section("controls", "Controls and vibration", _controls(data, stem)),
            Section("currents", "Currents", _currents(archive, data, place, stem)),
            provenance_section(archive, place, command),
        ),
    )


def _overview(archive: xr.DataTree, data: ProfileData, stem: str) -> Section:
    """What came out of it, its message, how much of it is sound, and its row of the table."""
    blocks: list[Block] = [Words(line + ".") for line in facts_of(data, None) if not line.startswith("note: ")]
    message = str(data.table["message"])
    if message:
        blocks.append(Notice(message))
    blocks.append(Grid(f"{stem}_quality", "Share of the samples that carry each quality bit.", _quality_rows(data)))
    blocks.append(Grid(f"{stem}_row", "Its row of the archive's table.", _row(archive, data.number)))
    return Section("profile", "The profile and its row of the archive", tuple(blocks))


def _row(archive: xr.DataTree, number: int) -> list[dict[str, Any]]:
    """One row a column of the archive's table, with unit and meaning."""
    row = archive.to_dataset().sel(profile=number).load()
    return [
        {"column": str(name), "value": flag_or_value(variable), "unit": str(variable.attrs.get("units", "1")),
         "meaning": str(variable.attrs.get("long_name", ""))}
        for name, variable in row.data_vars.items()
    ]  # fmt: skip


def flag_or_value(variable: xr.DataArray) -> str:
    """A value as text; a flag by its meaning."""
    value, meanings = variable.values[()], variable.attrs.get("flag_meanings")
    if meanings is None or not np.isfinite(value):
        return cell(value)
    texts = dict(zip(np.ravel(variable.attrs["flag_values"]).tolist(), str(meanings).split(), strict=True))
    return str(texts[int(value)]).replace("_", " ")


def _quality_rows(data: ProfileData) -> list[dict[str, Any]]:
    return [
        {"quality": meaning.replace("_", " "), "share of the samples, %": 100.0 * float(data.flagged(meaning).mean())}
        for meaning in QUALITY.meanings
    ]


def _windows(archive: xr.DataTree, data: ProfileData, stem: str) -> tuple[Block, ...]:
    windows = windows_of(archive, data)
    if not windows.outcome.size:
        return (Notice("the archive holds no window of this profile"),)
    caption = (
        "Every window of the inversion at the middle of its time: iterations, cost reached and optimality measure, "
        f"marked by how the solve ended. {_sentences(windows)}"
    )
    shown = "Iterations, cost and optimality measure of every window over the time of the profile, marked by outcome."
    return (
        Picture(f"{stem}_windows", caption, shown, windows_figure(data, windows)),
        Grid(f"{stem}_windows", "The windows, times since the profile's first sample.", window_rows(windows)),
    )


def _sentences(windows: Windows) -> str:
    counts = {outcome: int((windows.outcome == outcome).sum()) for outcome in Outcome}
    return " ".join(
        f"{outcome.name.capitalize().replace('_', ' ')} ({outcome.sentence}): {count} of {windows.outcome.size}."
        for outcome, count in counts.items() if count
    )  # fmt: skip


def _controls(data: ProfileData, stem: str) -> tuple[Block, ...]:
    caption = (
        "Recorded controls. Grey: the vibration set, where an actuator moved faster than the hull's thresholds or "
        "had done so within the guard time; the inversion keeps the filter's disturbance there and no statistic "
        "counts it."
    )
    shown = "Battery position and rotation, ballast volume and rudder over time, the vibration set shaded."
    picture = Picture(f"{stem}_controls", caption, shown, controls_figure(data))
    return (picture, Grid(f"{stem}_vibration", "Intervals of the vibration set.", vibration_rows(data)))


def _currents(archive: xr.DataTree, data: ProfileData, place: Place, stem: str) -> tuple[Block, ...]:
    caption = (
        "The track through the water under the identified disturbances and, closed on the fixes by the drift that "
        "it leaves, over the ground, with the depth-averaged current that is taken (arrow); beside it the same by the "
        "glide angle, which knows no disturbance. That the tracks meet the exit fix is by construction and confirms "
        "nothing; where they part in between says how far the two ways through the water differ."
    )
    blocks: list[Block] = [
        Grid(f"{stem}_currents", "Depth-averaged current by method, with one standard deviation where it has "
             "one; reports and exports take the smoother's wherever it is usable.", _current_rows(data)),
        Picture(f"{stem}_track", caption, f"Track of profile {data.number} from above, with fixes and current.",
                track_figure(archive, data)),
    ]  # fmt: skip
    return (*blocks, *depth_resolved_blocks(archive, data.number, place, stem))


def _current_rows(data: ProfileData) -> list[dict[str, Any]]:
    methods = {"smoother": "_smoothed", "inversion": "", "glide angle": "_glide_angle"}
    taken = {SMOOTHED: "smoother", ADJOINT: "inversion"}.get(str(taken_current(data.table).estimate))
    rows = []
    for method, suffix in methods.items():
        row: dict[str, Any] = {"method": method, "taken": "yes" if method == taken else ""}
        for along in ("north", "east"):
            row[f"{along}, m/s"] = _of(data, f"dac_{along}{suffix}")
            row[f"{along} std, m/s"] = _of(data, f"dac_{along}{suffix}_std")
        rows.append(row)
    return rows


def _of(data: ProfileData, name: str) -> float:
    return float(data.table.get(name, np.nan))
