"""Change of the compass's error during a mission, from legs on headings that are flown in turn."""

import numpy as np
import pytest
from record_checks.test_compass_rotation import blocks, leg

from gliderhpc.record_checks import CheckSettings, CheckVerdict
from gliderhpc.record_checks.compass_change import CHANGE, change_finding

CHECKS = CheckSettings()
COURSES = (75.0, 165.0, 255.0, 345.0)


def legs(seed, growth=(0.0,) * 5, step=None, count=24, scatter=0.01, courses=COURSES):
    """Legs on courses in turn; errors (5,) of the compass, degree, grow linearly or are there from one leg on."""
    rng = np.random.default_rng([61, seed])
    found = []
    for n in range(count):
        heading = np.radians(courses[n % len(courses)] + rng.normal(0.0, 15.0))
        part = n / (count - 1) if step is None else float(n >= step)
        current, motion = scatter * rng.standard_normal(2), 0.3 * np.array([np.cos(heading), np.sin(heading)])
        found.append(leg(0.8 * n, current, motion, 45.0, tuple(part * np.array(growth))))
    return found


@pytest.mark.parametrize(
    ("growth", "step"), [((0.0, 12.0, -8.0, 0.0, 0.0), None), ((12.0, 0.0, 0.0, 0.0, 0.0), 12)], ids=["grows", "jumps"]
)
def test_an_error_of_the_compass_that_changes_is_found(growth, step):
    found = [change_finding(legs(seed, growth, step), CHECKS) for seed in range(4)]
    assert sum(finding.found for finding in found) >= 3
    assert np.median([finding.size for finding in found]) == pytest.approx(np.linalg.norm(growth), rel=0.6)
    assert all(finding.quantity == CHANGE and "each part with its own" in finding.suggestion for finding in found)


@pytest.mark.parametrize("errors", [(0.0,) * 5, (6.0, 9.0, -5.0, 0.0, 0.0)], ids=["none", "constant"])
def test_an_error_that_stays_is_no_change(errors):
    found = [change_finding(legs(seed, errors, step=0), CHECKS) for seed in range(6)]
    assert not any(finding.found for finding in found)


def test_few_legs_scattered_currents_or_one_oscillation_do_not_determine_a_change():
    few, scattered, rotating = (change_finding(each, CHECKS) for each in (
        legs(0, count=7), legs(0, count=8, scatter=0.3), blocks()
    ))  # fmt: skip
    assert few.remark == "7 legs, but at least 8 are needed"
    assert {each.verdict for each in (few, scattered)} == {CheckVerdict.UNDETERMINED}
    assert not rotating.found
