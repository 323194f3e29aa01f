"""All checks of a mission's records."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.currents import CurrentSettings
from gliderhpc.estimation.preparation import on_steps
from gliderhpc.estimation.record_checks.compass import compass_findings
from gliderhpc.estimation.record_checks.finding import CheckSettings, Finding, Verdict
from gliderhpc.estimation.record_checks.lag import lag_finding
from gliderhpc.estimation.record_checks.legs import Leg, leg_of
from gliderhpc.estimation.record_checks.pitch import pitch_findings
from gliderhpc.estimation.record_checks.turns import TurnStretches, turn_information, turn_stretches
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.steady_segments import SegmentSettings, SteadySegments, joined, segments_of
from gliderhpc.estimation.tuning_records import spread_over
from gliderhpc.observations import Observations, ProfileSeries
from gliderhpc.platform import Platform

log = logging.getLogger("gliderhpc.inspect")


@dataclass(frozen=True)
class Inspection:
    """What the checks found.

    Attributes
    ----------
    findings : tuple of Finding
        One or more a check.
    profiles : tuple of int
        Profiles that were looked at.
    """

    findings: tuple[Finding, ...]
    profiles: tuple[int, ...]

    @property
    def found(self) -> tuple[Finding, ...]:
        """The findings beyond their threshold."""
        return tuple(finding for finding in self.findings if finding.verdict is Verdict.FOUND)


@dataclass
class _Gathered:
    """What the checks need of the profiles read so far."""

    legs: list[Leg]
    turns: list[TurnStretches]
    segments: list[SteadySegments]
    series: dict[int, ProfileSeries]


def inspect_records(
    observations: Observations, platform: Platform, numbers: Sequence[int], settings: EstimationSettings,
    checks: CheckSettings, current: CurrentSettings,
) -> Inspection:  # fmt: skip
    """Check records for a lag, an offset of the pitch and errors of the compass. Nothing is corrected.

    Parameters
    ----------
    observations, platform : Observations, Platform
        The open file and the hull.
    numbers : sequence of int
        Profiles to choose among; faulty ones are passed over.
    settings, checks, current : EstimationSettings, CheckSettings, CurrentSettings
        How records are brought onto the steps (corrections asked for included), when a finding counts, how currents
        are found.

    Raises
    ------
    InputError
        None of the profiles can be used.
    """
    usable = [number for number in numbers if number not in observations.faults]
    chosen = spread_over(usable, checks.profiles)
    for_lag = set(spread_over(chosen, checks.lag_profiles))
    gathered, reason = _Gathered([], [], [], {}), "every one has a fault"
    read = []
    for number in chosen:
        try:
            _gather(observations, platform, number, settings, current, gathered, keep=number in for_lag)
            read.append(number)
        except ProfileError as error:
            reason = str(error)
            log.warning("profile %d is left out: %s", number, reason)
    if not read:
        raise InputError(f"{observations.path}: no profile to inspect can be used; {reason}")
    segments = joined(gathered.segments) if gathered.segments else None
    findings = [
        lag_finding(platform, list(gathered.series.values()), settings, checks),
        *pitch_findings(platform, segments, checks),
        *compass_findings(gathered.legs, turn_information(gathered.turns), checks),
    ]
    return Inspection(tuple(findings), tuple(read))


def _gather(
    observations: Observations, platform: Platform, number: int, settings: EstimationSettings,
    current: CurrentSettings, gathered: _Gathered, *, keep: bool,
) -> None:  # fmt: skip
    record = observations.profile(number)
    series = on_steps(record, settings)
    if keep:
        gathered.series[number] = series
    leg = leg_of(platform, record, series, current)
    if leg is not None:
        gathered.legs.append(leg)
    gathered.turns.append(turn_stretches(platform, series))
    try:
        gathered.segments.append(segments_of(series, platform, SegmentSettings()))
    except ProfileError as error:
        log.info("profile %d has no steady flight: %s", number, error)
