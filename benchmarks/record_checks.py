"""Checks of the records on twins whose records carry known errors, and on real missions; writes ``docs/record-checks.md``.

Usage: ``python -m benchmarks.record_checks [NAME=OBSERVATIONS:PLATFORM ...]``, where OBSERVATIONS are imported records.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gliderhpc import load_platform
from gliderhpc.estimation.corrections import harmonics
from gliderhpc.estimation.record_checks import InspectSettings
from gliderhpc.estimation.settings import RecordSettings
from gliderhpc.observations import ProfileRecord
from gliderhpc.observations.synthetic import Scenario, load_scenario, simulate_profile
from gliderhpc.platform import Platform

PLATFORM = "petrel-l"
PROFILES = 24
COURSES = (20.0, 200.0, 110.0, 290.0, 65.0, 245.0, 155.0, 335.0)
OPPOSITE = (75.0, 255.0)
SETTINGS = InspectSettings()
CLEAN = RecordSettings()


def twin_scenario(name: str = "impulses", legs: tuple[float, ...] = COURSES) -> Scenario:
    """Scenario of the twins: short profiles on the courses given."""
    return load_scenario(name).replaced(
        {"depth": 120.0, "depth_spread": 0.0, "profiles": PROFILES, "steering": {"courses": legs}}
    )


def twin_records(
    seed: int, errors: RecordSettings = CLEAN, scenario: Scenario | None = None, platform: Platform | None = None
) -> Iterator[ProfileRecord]:
    """Simulate a mission's profiles, with errors put into their records that `errors` would take out again."""
    platform, scenario = platform or load_platform(PLATFORM), scenario or twin_scenario()
    for number in range(1, scenario.profiles + 1):
        record, _ = simulate_profile(platform, scenario, seed, number=number)
        yield spoilt(record, errors)


def spoilt(record: ProfileRecord, errors: RecordSettings) -> ProfileRecord:
    """Put into a record what `errors` takes out."""
    reading = record.heading
    for _ in range(20):
        error = np.radians(errors.heading_offset + harmonics(reading) @ np.array(errors.heading_deviation))
        reading = record.heading + error
    return replace(
        record,
        pitch=record.pitch + np.radians(errors.pitch_offset),
        heading=np.mod(reading, 2.0 * np.pi),
        depth=np.interp(record.time - errors.depth_lag, record.time, record.depth),
    )
