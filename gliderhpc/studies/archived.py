"""Content of an archive for the studies: their provenance and tables, and profiles in SI units and radians."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import ValidationError

from gliderhpc.archive.profile import SMOOTHED, ProfileData, done_profiles, filter_fallbacks
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError
from gliderhpc.findings.results import as_plain
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import ProfileSeries
from gliderhpc.observations.intervals import usual_interval, without_gaps
from gliderhpc.observations.profile_numbers import select_profiles
from gliderhpc.platform import CUBIC_CENTIMETRE, Platform
from gliderhpc.store_schema.maintenance import OUTDATED
from gliderhpc.store_schema.schema import PROFILE

Array = NDArray[np.float64]

QUICK_PROFILES = 3

CONTROLS_SI = np.array([1.0, np.pi / 180.0, CUBIC_CENTIMETRE, np.pi / 180.0])
"""Factors from the archive's units of the controls to those of the model."""

_MEASURED_SI = np.array([np.pi / 180.0] * 3 + [1.0])


@dataclass(frozen=True)
class Provenance:
    """Profiles, columns, estimate, settings and remarks of a study, stored in its group's attributes.

    Tables and figures of the study are made from this and the group's arrays alone.

    Attributes
    ----------
    profiles : tuple of int
        Profiles studied, with or without a result.
    columns : tuple of str
        Columns of the study's table, in order; those that the group lacks are taken from the mission's table.
    estimate : str
        Estimate of disturbances and motion.
    quick : bool
        Whether the study had its reduced size, for a first look.
    settings : mapping
        Settings of the study, as JSON values.
    remarks : tuple of str
        Remarks on the inputs, for example on a missing one.
    """

    profiles: tuple[int, ...]
    columns: tuple[str, ...]
    estimate: str
    quick: bool
    settings: Mapping[str, Any]
    remarks: tuple[str, ...]

    def attributes(self) -> dict[str, Any]:
        """Return the values as attributes of the group."""
        return asdict(self)


def provenance_of(archive: Archive, name: str) -> Provenance:
    """Read the provenance of a study.

    Raises
    ------
    InputError
        The study was written by a version of this program that did not record it.
    """
    values = {field.name: stored_attribute(archive, name, field.name) for field in fields(Provenance)}
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
    outdated = outdated_because(archive, name)
    if outdated:
        values["remarks"] += (f"this study was {outdated}; run it again",)
    return Provenance(**values)


def outdated_because(archive: Archive, name: str) -> str:
    """Return why a study's group no longer fits its archive; empty if it does, or if there is no such group."""
    return str(archive[name].attrs.get(OUTDATED, "")) if name in archive.children else ""


def outdated_input_remarks(archive: Archive, *names: str) -> tuple[str, ...]:
    """Return a remark for each study that another one uses and that no longer fits its archive."""
    reasons = {name: outdated_because(archive, name) for name in names}
    return tuple(
        f"this study uses the study {name}, which was {why}; run {name} again, and then this study"
        for name, why in reasons.items()
        if why
    )


def stored_attribute(archive: Archive, name: str, key: str) -> Any:
    """Return an attribute of a study's group.

    Raises
    ------
    InputError
        The study was written by a version of this program that did not record it.
    """
    attributes = archive[name].attrs
    if key not in attributes:
        raise InputError(
            f"the archive's study {name} does not record its {key}, because an earlier version of gliderhpc wrote it; "
            "run it again"
        )
    return attributes[key]


def platform_of(archive: Archive) -> Platform:
    """Return the hull that an archive's profiles were estimated with.

    Raises
    ------
    InputError
        This program cannot read the archive's platform.
    """
    platform = platform_or_none(archive)
    if platform is None:
        raise InputError("the archive's platform cannot be read by this version; re-run the mission")
    return platform


def platform_or_none(archive: Archive) -> Platform | None:
    """Return the hull that an archive's profiles were estimated with, None if this program cannot read it."""
    try:
        return Platform.model_validate(archive.attrs.get("platform"))
    except ValidationError:
        return None


def windows_start(archive: Archive) -> str:
    """Return the path that the windows of an archive started from: ``prior`` or ``smoothed``."""
    return str(archive.attrs.get("start", "prior"))


def settings_of(archive: Archive) -> MissionSettings:
    """Return the settings that an archive's profiles were estimated with.

    Raises
    ------
    InputError
        This program cannot read the archive's settings.
    """
    try:
        return MissionSettings.model_validate(archive.attrs["settings"])
    except (KeyError, ValidationError):
        raise InputError("the archive's settings cannot be read by this version; re-run the mission") from None


def positions(archive: Archive) -> dict[int, int]:
    """Return the index of every profile along the archive's profile dimension, by profile number."""
    return {int(number): index for index, number in enumerate(archive.to_dataset()["profile"].values)}


def chosen_profiles(archive: Archive, text: str | None, quick: bool = False) -> tuple[int, ...]:
    """Choose among an archive's finished profiles; a quick study uses the first few.

    Raises
    ------
    InputError
        No profile is done, or the text names one that is not.
    """
    done = done_profiles(archive)
    if not done:
        raise InputError("no profile of the archive is done, so there is nothing to study")
    return chosen_among(done, text, quick)


def chosen_among(numbers: Sequence[int], text: str | None, quick: bool = False) -> tuple[int, ...]:
    """Choose among profile numbers; a quick study uses the first few.

    Raises
    ------
    InputError
        The text names one that is not among them.
    """
    chosen = select_profiles(numbers, text)
    return chosen[:QUICK_PROFILES] if quick else chosen


def study_table(archive: Archive, name: str) -> pd.DataFrame:
    """Return a study's table, with a row for each profile requested and the columns in the study's order.

    Missing numbers and missing text are NaN. Columns that the study does not store are taken from the mission's table.

    Raises
    ------
    InputError
        The study was written by a version of this program that did not record its columns.
    """
    provenance = provenance_of(archive, name)
    own, mission = (node.to_dataset() for node in (archive[name], archive))
    at = {PROFILE: list(provenance.profiles)}
    columns = {column: (own if column in own else mission)[column].sel(at).values for column in provenance.columns}
    return pd.DataFrame({column: as_cells(values) for column, values in columns.items()})


def failed_profiles(table: pd.DataFrame) -> tuple[dict[int, str], pd.DataFrame]:
    """Separate the messages of a study's failed profiles, by number, from the rows of the others."""
    if "message" not in table:
        return {}, table
    has_message = table["message"].notna()
    failed = {int(number): str(text) for number, text in table.loc[has_message, ["profile", "message"]].to_numpy()}
    return failed, table[~has_message]


def column_medians(table: pd.DataFrame) -> dict[str, float | None]:
    """Medians of a study's numeric columns except the days; None if a column has no values."""
    numbers = table.drop(columns=["profile", "elapsed_days"], errors="ignore")
    medians: dict[str, float | None] = as_plain(numbers.median(numeric_only=True).to_dict())
    return medians


def mission_of(archive: Archive) -> str:
    """Return the mission's name, for titles."""
    return str(archive.attrs.get("mission") or "mission")


def as_cells(values: NDArray[Any]) -> NDArray[Any]:
    """Return a column as shown in tables: NaN for missing text, and times to the microsecond, as archived."""
    if values.dtype.kind == "M":
        return pd.DatetimeIndex(values).round("us").to_numpy()
    if values.dtype.kind not in "OTU":
        return values
    return np.array([str(text) if text else np.nan for text in values], dtype=object)


def estimate_remarks(archive: Archive, estimate: str, numbers: Sequence[int]) -> tuple[str, ...]:
    """Remarks on an estimate for a study: the profiles without a smoothed estimate.

    Raises
    ------
    InputError
        The archive has no such estimate.
    """
    if estimate != SMOOTHED:
        return ()
    without = filter_fallbacks(archive, numbers)
    if not without:
        return ()
    named = ", ".join(map(str, without))
    return (f"where the smoother has no estimate, that of the filter is used: profile {named}",)


def series_of(data: ProfileData, platform: Platform) -> ProfileSeries:
    """Rebuild a profile's series on the archive's records, one output interval apart.

    Missing measurements are interpolated and have weight zero.
    """
    time, known = data.record_time, np.isfinite(data.measured).all(axis=1)
    if not known.any():
        raise InputError(f"profile {data.number}: the archive holds none of its measurements")
    filled = np.column_stack([np.interp(time, time[known], column[known]) for column in data.measured.T])
    interval = float(data.attributes["output_interval"])
    return ProfileSeries(
        number=data.number,
        epoch=data.epoch,
        step=interval,
        time=time,
        measurements=filled * _MEASURED_SI,
        weights=np.where(known, 1.0, 0.0),
        controls=data.controls[:-1] * CONTROLS_SI,
        sample_interval=max(interval, sample_interval(data, platform)),
        gap_seconds=float(np.count_nonzero(~known)) * interval,
        sample_index=np.flatnonzero(known),
        seawater=None if data.seawater is None else np.column_stack([filled[:-1, 3], data.seawater[:-1]]),
    )


def sample_interval(data: ProfileData, platform: Platform) -> float:
    """Usual time between the instrument's samples (s); the hull's nominal one if the archive does not record it."""
    intervals = without_gaps(np.diff(data.record_time[data.sampled]))
    return usual_interval(intervals) if len(intervals) else platform.sensors.sample_interval


def states_of(data: ProfileData) -> Array:
    """Rebuild the states ``(m, 12)`` of eq. 16 on the records, with X and Y relative to the start of the profile."""
    north, east, u, v, w, p, q, r = data.motion.T
    roll, pitch, heading = np.radians(data.reconstructed[:, :3]).T
    rates = np.radians(np.column_stack([p, q, r]))
    return np.column_stack([roll, pitch, heading, north, east, data.reconstructed[:, 3], u, v, w, rates])
