"""State of one mission of a fleet, the source of its row on the fleet's page, its track and its CSV row."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from gliderhpc.archive.mission import Summary, archive_errors, describe, open_for_reading, platform_name
from gliderhpc.archive.reader import Archive
from gliderhpc.findings.formatting import iso_instant, polar
from gliderhpc.observations.fixes import midpoint
from gliderhpc.observations.regions import wrapped_longitude
from gliderhpc.report.page.content import Row
from gliderhpc.report.page.fleet_map import Array, FleetTrack
from gliderhpc.report.page.mission_table import MissionTable, last_current
from gliderhpc.report.page.operator_summary import profile_anomalies
from gliderhpc.report.studies import studies_in
from gliderhpc.report.studies.hull import StoredChange, stored_changes
from gliderhpc.store_schema.location import Location
from gliderhpc.studies.registry import ALL_STUDIES
from gliderhpc.surfacing.dive_results import has_smoothed, read_best_estimate, water_of_dive
from gliderhpc.surfacing.message import Current, Water

_ENDS = ("entry_latitude", "entry_longitude", "exit_latitude", "exit_longitude")


@dataclass(frozen=True, eq=False)
class MissionState:
    """State of a mission.

    Attributes
    ----------
    summary : Summary
        Summary of the archive.
    table : MissionTable
        Profiles of the archive.
    current_of, current : int, Current or None
        Number of the last profile with a current, and that current.
    water_of, water : int, Water or None
        Number of the last profile that is done, and its motion through the water.
    hull : tuple of StoredChange or None
        Findings of study ``hull``; None if there are none.
    anomalies : tuple of str
        Anomalies of its profiles and studies.
    """

    summary: Summary
    table: MissionTable
    current_of: int = 0
    current: Current | None = None
    water_of: int = 0
    water: Water | None = None
    hull: tuple[StoredChange, ...] | None = None
    anomalies: tuple[str, ...] = field(default=())

    @property
    def mission(self) -> str:
        """Name of the mission."""
        return str(self.summary.attributes.get("mission") or "mission")

    @property
    def cells(self) -> dict[str, tuple[str, ...]]:
        """Lines of each column on the page."""
        return {
            "platform": tuple(filter(None, (platform_name(self.summary.attributes), self._platform_id))),
            "time": self._time,
            "dives": tuple(f"{count} {status}" for status, count in self._counts.items() if count or status == "done"),
            "last current": self._current_lines,
            "through the water": self._water_lines,
            "hull": self._hull_lines,
            "anomalies": self.anomalies or ("none",),
        }

    @property
    def _platform_id(self) -> str:
        return str(self.summary.attributes.get("platform_id") or "")

    @property
    def _counts(self) -> dict[str, int]:
        return {status: self.summary.statuses.get(status, 0) for status in ("done", "failed", "pending")}

    @property
    def _time(self) -> tuple[str, ...]:
        first, last = self._span
        return () if first is None or last is None else (f"{_minute(first)} to", f"{_minute(last)} UTC")

    @property
    def _span(self) -> tuple[str | None, str | None]:
        """Times of the first sample of the first profile and of the last sample of the last profile."""
        return iso_instant(self.summary.first_time), iso_instant(self.summary.last_time)

    @property
    def _current_lines(self) -> tuple[str, ...]:
        if self.current is None:
            return ("none",)
        ellipse = self.current.ellipse
        error = f"± {ellipse.major:.3f} by {ellipse.minor:.3f}" if math.isfinite(ellipse.major) else "error unknown"
        return polar(self.current.north, self.current.east), error, self._dive(self.current_of)

    def _dive(self, number: int) -> str:
        began = iso_instant(self.table.dataset["start_time"].sel(profile=number).values)
        return f"dive {number}" if began is None else f"dive {number}, {began[:10]}"

    @property
    def _water_lines(self) -> tuple[str, ...]:
        if self.water is None:
            return ()
        deviation = self.water.horizontal_speed_std
        error = "" if deviation is None else f" ± {deviation:.3f}"
        horizontal = f"{self.water.horizontal_speed:.3f}{error} m/s horizontally"
        return f"{self.water.speed:.3f} m/s along the path", horizontal, self._dive(self.water_of)

    @property
    def _hull_lines(self) -> tuple[str, ...]:
        if self.hull is None:
            return ("not studied",)
        return tuple(change.sentence for change in self.hull) or ("too few dives",)

    def row(self) -> Row:
        """Return the row of the CSV file, numbers at full precision."""
        current, water, (first, last) = self.current, self.water, self._span
        drag, volume = (self._change(key) for key in ("viscous.K_D0", "buoyancy.neutral_volume"))
        return {
            "mission": self.mission, "platform": platform_name(self.summary.attributes),
            "platform_id": self._platform_id, "from": first, "to": last, **self._counts,
            "current of profile": current and self.current_of, "current north, m s-1": current and current.north,
            "current north std, m s-1": current and current.north_std, "current east, m s-1": current and current.east,
            "current east std, m s-1": current and current.east_std,
            "current covariance, m2 s-2": current and current.covariance,
            "water of profile": water and self.water_of, "speed through the water, m s-1": water and water.speed,
            "horizontal speed, m s-1": water and water.horizontal_speed,
            "horizontal speed std, m s-1": water and water.horizontal_speed_std,
            "change of drag, kg m-1": drag and drag.size, "change of drag std, kg m-1": drag and drag.std,
            "probability that drag changed": drag and drag.probability,
            "change of neutral volume, cm3": volume and volume.size,
            "change of neutral volume std, cm3": volume and volume.std,
            "probability that neutral volume changed": volume and volume.probability,
            "anomalies": "; ".join(self.anomalies),
        }  # fmt: skip

    def _change(self, key: str) -> StoredChange | None:
        return next((change for change in self.hull or () if change.key == key), None)

    def track(self, number: int, name: str) -> FleetTrack:
        """Return the track with its last current, for the map."""
        latitude, longitude = self.table.fixes
        fixes = np.column_stack([longitude.ravel(), latitude.ravel()])
        fixes = fixes[np.isfinite(fixes).all(axis=1)]
        position, current, deviations = (np.full(count, np.nan) for count in (2, 2, 3))
        if self.current is not None:
            last = self.current
            position = self._place(fixes)
            current = np.array([last.east, last.north])
            deviations = np.array([last.north_std, last.east_std, last.covariance])
        return FleetTrack(number, name, fixes, position, current, deviations)

    def _place(self, fixes: Array) -> Array:
        """Return longitude and latitude midway between the fixes of the dive with the last current."""
        row = self.table.dataset.sel(profile=self.current_of)
        a, b, c, d = (float(row[name]) for name in _ENDS)
        if not (np.isfinite([a, b, c, d]).all() and len(fixes)):
            return np.full(2, np.nan)
        latitude, longitude = midpoint((a, b), (c, d))
        # The longitude is on the branch of the track, which may have crossed the date line.
        return np.array([wrapped_longitude(longitude, float(fixes[-1, 0])), latitude])


def _minute(instant: str) -> str:
    return instant[:16].replace("T", " ")


def read_state(place: Location) -> MissionState:
    """Read the state of a mission from its archive.

    Raises
    ------
    InputError
        The archive cannot be read.
    """
    summary = describe(place)
    with archive_errors(place), open_for_reading(place) as archive:
        table = MissionTable.of(archive)
        current_of, current = last_current(table)
        done = table.number[table.done].tolist()
        water_of = int(done[-1]) if done else 0
        smoothed = bool(done) and has_smoothed(archive, water_of)
        data = read_best_estimate(archive, water_of, smoothed=smoothed) if done else None
        return MissionState(
            summary,
            table,
            current_of,
            current,
            water_of,
            None if data is None else water_of_dive(archive, data),
            stored_changes(archive),
            tuple(_anomalies(archive, summary, table)),
        )


def _anomalies(archive: Archive, summary: Summary, table: MissionTable) -> Iterator[str]:
    """Yield the anomalies of profiles and studies."""
    yield from profile_anomalies(summary, table)
    yield from (f"study {name}: {note}" for name, note in summary.notes.items() if name in ALL_STUDIES)
    missing = [name for name in ALL_STUDIES if name not in studies_in(archive) and name not in summary.notes]
    if len(missing) == len(ALL_STUDIES):
        yield "no study was run"
    elif missing:
        yield f"studies not run: {', '.join(missing)}"
