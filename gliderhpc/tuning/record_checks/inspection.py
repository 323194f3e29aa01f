"""All checks of a mission's records."""

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.current_errors import CurrentSettings
from gliderhpc.estimation.preparation import on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.observations import Observations, ProfileRecord, ProfileSeries
from gliderhpc.platform import Platform
from gliderhpc.tuning.likelihood import spread_over
from gliderhpc.tuning.record_checks.compass import Leg, compass_findings, leg_of
from gliderhpc.tuning.record_checks.finding import CheckSettings, Finding
from gliderhpc.tuning.record_checks.lag import lag_finding
from gliderhpc.tuning.record_checks.pitch import pitch_findings
from gliderhpc.tuning.record_checks.turns import TurnStretches, turn_information, turn_stretches
from gliderhpc.tuning.steady_segments import SegmentSettings, SteadySegments, joined, segments_of


@dataclass(frozen=True)
class Inspection:
    """Results of the checks.

    Attributes
    ----------
    findings : tuple of Finding
        One or more a check.
    profiles : tuple of int
        Profiles that were looked at.
    left_out : dict of int to str
        Those that could not be, and why.
    """

    findings: tuple[Finding, ...]
    profiles: tuple[int, ...]
    left_out: dict[int, str]

    @property
    def found(self) -> tuple[Finding, ...]:
        """The findings beyond their threshold."""
        return tuple(finding for finding in self.findings if finding.found)


@dataclass
class _Gathered:
    """Input of the checks from the profiles read so far."""

    legs: list[Leg]
    turns: list[TurnStretches]
    segments: list[SteadySegments]
    series: dict[int, ProfileSeries]
    numbers: list[int]

    def add(
        self, platform: Platform, record: ProfileRecord, settings: EstimationSettings, current: CurrentSettings, *,
        keep: bool,
    ) -> None:  # fmt: skip
        """Add a profile's input to the checks; its series, which is large, only if `keep`."""
        series = on_steps(record, settings)
        self.numbers.append(record.number)
        if keep:
            self.series[record.number] = series
        leg = leg_of(platform, record, series, current.errors(platform))
        if leg is not None:
            self.legs.append(leg)
        self.turns.append(turn_stretches(platform, series))
        with contextlib.suppress(ProfileError):  # A dive without steady flight has no part in the pitch alone.
            self.segments.append(segments_of(series, platform, SegmentSettings()))


def inspect_records(
    observations: Observations, platform: Platform, numbers: Sequence[int], settings: EstimationSettings,
    checks: CheckSettings, current: CurrentSettings,
) -> Inspection:  # fmt: skip
    """Check records for a lag, an offset and scale of the pitch and errors of the compass; nothing is corrected.

    Parameters
    ----------
    observations, platform : Observations, Platform
        The open file and the hull.
    numbers : sequence of int
        Profiles to choose among; faulty ones are passed over.
    settings, checks, current : EstimationSettings, CheckSettings, CurrentSettings
        How records are brought onto the steps (corrections asked for included), when a finding counts, how currents
        are found.
    """
    usable = [number for number in numbers if number not in observations.faults]
    chosen = spread_over(usable, checks.profiles)
    records = (observations.profile(number) for number in chosen)
    found = inspect_profiles(records, platform, settings, checks, current, spread_over(chosen, checks.lag_profiles))
    faults = {number: observations.faults[number] for number in numbers if number in observations.faults}
    return replace(found, left_out=faults | found.left_out)


def inspect_profiles(
    records: Iterable[ProfileRecord], platform: Platform, settings: EstimationSettings, checks: CheckSettings,
    current: CurrentSettings, for_lag: Sequence[int],
) -> Inspection:  # fmt: skip
    """Check records as they come, as `inspect_records` does; the lag on the profiles of the numbers given."""
    gathered, left_out = _Gathered([], [], [], {}, []), {}
    for record in records:
        try:
            gathered.add(platform, record, settings, current, keep=record.number in for_lag)
        except ProfileError as error:
            left_out[record.number] = str(error)
    segments = joined(gathered.segments) if gathered.segments else None
    turns = turn_information(gathered.turns, np.radians(checks.plausible_deviation))
    findings = [
        lag_finding(platform, list(gathered.series.values()), settings, checks),
        *pitch_findings(platform, segments, checks, settings.records),
        *compass_findings(gathered.legs, turns, checks),
    ]
    return Inspection(tuple(findings), tuple(gathered.numbers), left_out)
