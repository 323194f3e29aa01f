"""Checks of records on twins with known errors and on real missions; writes ``docs/record-checks.md``.

Usage: ``python -m benchmarks.record_checks [NAME=OBSERVATIONS:PLATFORM ...]``, where OBSERVATIONS are imported records.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.command_line import positional
from benchmarks.sections import with_section
from gliderhpc import load_platform
from gliderhpc.estimation.resample import harmonics
from gliderhpc.estimation.settings import RecordSettings
from gliderhpc.findings.formatting import markdown
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import ProfileRecord, open_observations
from gliderhpc.observations.profile_numbers import evenly_spaced
from gliderhpc.record_checks import CheckVerdict, Finding, Inspection, inspect_records
from gliderhpc.record_checks.compass import CONSTANT, DEVIATION
from gliderhpc.record_checks.finding import HEADINGS
from gliderhpc.record_checks.inspection import LAG, inspect_profiles
from gliderhpc.record_checks.pitch import GAIN, PITCH, VOLUME
from gliderhpc.simulator import Scenario, load_scenario, simulate_profile

PLATFORM = "petrel-l"
PROFILES = 24
COURSES = (20.0, 200.0, 110.0, 290.0, 65.0, 245.0, 155.0, 335.0)
PITCHES = (20.0, 30.0, 24.0, 38.0)
"""Of the profiles in turn, degree: on glides of one steepness the pitch cannot be distinguished from the hull."""
SCENARIOS = ("calm", "impulses")
SEEDS = 20
SETTINGS = MissionSettings()
CLEAN = RecordSettings()
ADDED_ERRORS = RecordSettings(
    depth_lag=3.0, pitch_offset=1.5, heading_offset=8.0, heading_deviation=(12.0, -8.0, 4.0, 0.0)
)
PAGE = Path(__file__).resolve().parents[1] / "docs" / "record-checks.md"


def twin_scenario(name: str = "impulses", legs: tuple[float, ...] = COURSES) -> Scenario:
    """Scenario of the twins: short profiles on the courses given."""
    return load_scenario(name).replaced(
        {"depth": 120.0, "depth_spread": 0.0, "profiles": PROFILES, "steering": {"courses": legs}}
    )


def twin_records(seed: int, scenario: Scenario) -> list[ProfileRecord]:
    """Simulate a mission's profiles."""
    platform = load_platform(PLATFORM)
    return [
        simulate_profile(platform, _at_pitch(scenario, PITCHES[number % len(PITCHES)]), seed, number=number)[0]
        for number in range(1, scenario.profiles + 1)
    ]


def _at_pitch(scenario: Scenario, pitch: float) -> Scenario:
    return scenario.replaced({"actuation": {"pitch": pitch}})


def with_errors(record: ProfileRecord, errors: RecordSettings) -> ProfileRecord:
    """Put into a record what `errors` takes out."""
    reading = record.heading
    for _ in range(20):
        error = np.radians(errors.heading_offset + harmonics(reading) @ np.array(errors.heading_deviation))
        reading = record.heading + error
    return replace(
        record,
        pitch=record.pitch / errors.pitch_scale + np.radians(errors.pitch_offset),
        heading=np.mod(reading, 2.0 * np.pi),
        depth=np.interp(record.time - errors.depth_lag, record.time, record.depth),
    )


def inspect_open(records: Sequence[ProfileRecord], errors: RecordSettings = CLEAN) -> Inspection:
    """Checks of a twin's records with errors put into them."""
    numbers = evenly_spaced([record.number for record in records], SETTINGS.inspect.lag_profiles)
    bad = (with_errors(record, errors) for record in records)
    platform = load_platform(PLATFORM)
    return inspect_profiles(bad, platform, SETTINGS, SETTINGS.inspect, SETTINGS.current, numbers)


def expected(finding: Finding, errors: RecordSettings) -> float:
    """Size that a finding should have."""
    truth = {
        LAG: errors.depth_lag,
        PITCH: errors.pitch_offset,
        GAIN: errors.pitch_scale - 1.0,
        CONSTANT: errors.heading_offset,
        VOLUME: 0.0,
        DEVIATION: float(np.linalg.norm(errors.heading_deviation)),
    }
    return truth[finding.quantity]


def twin_table(errors: RecordSettings, found: Sequence[Inspection]) -> str:
    """Markdown of every quantity over the twins."""
    rows = []
    for quantity in (LAG, PITCH, GAIN, VOLUME, CONSTANT, DEVIATION):
        here = [f for one in found for f in one.findings if f.quantity == quantity]
        decided = [f for f in here if f.verdict is not CheckVerdict.UNDETERMINED]
        if not decided:
            continue
        truth = expected(decided[0], errors)
        sizes, stated = np.array([f.size for f in decided]), np.array([f.error for f in decided])
        # An amplitude is never below zero: its errors are those of its components, which the size does not show.
        scatter = "" if quantity == DEVIATION else f"{np.sqrt(np.mean((sizes - truth) ** 2)):.2g}"
        rows.append([
            f"{quantity}, {decided[0].unit}", f"{truth:.3g}", f"{np.mean(sizes):.3g}", scatter, f"{np.median(stated):.2g}",
            f"{np.median([f.threshold for f in decided]):.2g}",
            f"{sum(f.verdict is CheckVerdict.FOUND for f in decided)} of {len(decided)}", str(len(here) - len(decided)),
        ])  # fmt: skip
    return markdown(
        ("quantity", "truth", "mean estimate", "error, RMS", "stated", "threshold", "found", "not determined"), rows
    )


def real_table(found: Mapping[str, Inspection]) -> str:
    """Markdown of every finding on real missions."""
    rows = [[name, *finding.cells[1:]] for name, inspection in found.items() for finding in inspection.findings]
    return markdown(("mission", *HEADINGS[1:]), rows)


def inspected_mission(observations: Path, platform: str) -> Inspection:
    """Checks of a mission's own records."""
    with open_observations(observations) as opened:
        return inspect_records(
            opened, load_platform(platform), opened.profile_numbers, SETTINGS, SETTINGS.inspect, SETTINGS.current
        )


def twin_sections() -> dict[str, str]:
    """Tables of twins without errors and with them, of the same flights."""
    tables: dict[str, list[str]] = {"clean": [], "with-errors": []}
    for scenario in SCENARIOS:
        flown = [twin_records(seed, twin_scenario(scenario)) for seed in range(SEEDS)]
        title = f"Scenario `{scenario}`, {SEEDS} missions of {PROFILES} profiles:"
        for name, errors in (("clean", CLEAN), ("with-errors", ADDED_ERRORS)):
            tables[name].append(f"{title}\n\n{twin_table(errors, [inspect_open(one, errors) for one in flown])}")
    return {name: "\n\n".join(parts) for name, parts in tables.items()}


def put(sections: Mapping[str, str]) -> None:
    """Put sections into the page."""
    text = PAGE.read_text("utf-8")
    for name, section in sections.items():
        text = with_section(text, name, section)
    PAGE.write_text(text, "utf-8")


def main(arguments: Sequence[str]) -> None:
    """Run the study and put its tables into the page."""
    missions = {}
    for argument in arguments:
        name, _, rest = argument.partition("=")
        observations, _, platform = rest.rpartition(":")
        missions[name] = (Path(observations), platform)
    put(twin_sections())
    if missions:
        put({"real": real_table({name: inspected_mission(*mission) for name, mission in missions.items()})})


if __name__ == "__main__":
    main(positional(__doc__, missions={"nargs": "*"}).missions)
