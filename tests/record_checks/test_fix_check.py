"""Error of the GPS fixes: found from their scatter, not from the drift at the surface."""

import numpy as np
import pytest

from gliderhpc.estimation.current_errors import CurrentSettings
from gliderhpc.observations import Fix
from gliderhpc.record_checks.finding import CheckVerdict
from gliderhpc.record_checks.fixes import LONGEST_PAIR, LONGEST_TRIPLE, fix_finding

START = np.datetime64("2026-01-01T00:00:00", "ns")
METRES_PER_DEGREE = 111_195.0
CURRENT = CurrentSettings()


def surfacings(count, times, error, drift_std=0.2, seed=0):
    """Fixes of surfacings an hour apart on the equator, that drift steadily and have independent errors (m)."""
    rng = np.random.default_rng([91, seed])
    groups = []
    for number in range(count):
        drift = rng.normal(0.1, drift_std, 2)
        fixes = []
        for time in times:
            north, east = drift * time + rng.normal(0.0, error, 2)
            when = START + np.timedelta64(int(3600 * number + time), "s")
            fixes.append(Fix(when, north / METRES_PER_DEGREE, 20.0 + east / METRES_PER_DEGREE))
        groups.append(tuple(fixes))
    return groups


@pytest.mark.parametrize("times", [(0, 60), (0, 40, 100, 180)], ids=["pairs", "triples"])
@pytest.mark.parametrize("error", [50.0, 75.0])
def test_noisy_fixes_are_found_with_their_error(times, error):
    found = [fix_finding(surfacings(20, times, error, seed=seed), CURRENT) for seed in range(10)]
    assert {finding.verdict for finding in found} == {CheckVerdict.FOUND}
    assert np.median([finding.size for finding in found]) == pytest.approx(error, rel=0.2)
    assert found[0].suggestion == f"`current.fix_error={found[0].size:.2g}`"


@pytest.mark.parametrize("drift_std", [0.1, 0.5])
@pytest.mark.parametrize("times", [(0, 60), (0, 100, 250)], ids=["pairs", "triples"])
def test_good_fixes_are_not_reported_whatever_the_drift(times, drift_std):
    found = [fix_finding(surfacings(20, times, 4.0, drift_std, seed), CURRENT) for seed in range(10)]
    assert {finding.verdict for finding in found} == {CheckVerdict.NOTHING}


def test_a_stated_error_is_not_reported_again():
    noisy = surfacings(20, (0, 60), 75.0)
    assert fix_finding(noisy, CurrentSettings(fix_error=75.0)).verdict is CheckVerdict.NOTHING


def test_a_surfacing_between_two_profiles_counts_once():
    noisy = surfacings(3, (0, 60), 75.0)
    assert fix_finding([*noisy, *noisy], CURRENT).verdict is CheckVerdict.UNDETERMINED


@pytest.mark.parametrize("times", [(0,), (0, LONGEST_PAIR + 1), (0, LONGEST_PAIR + 1, LONGEST_TRIPLE + 1)])
def test_single_fixes_and_those_far_apart_determine_nothing(times):
    finding = fix_finding(surfacings(20, times, 75.0), CURRENT)
    assert finding.verdict is CheckVerdict.UNDETERMINED
    assert "at least 4 are needed" in finding.remark
