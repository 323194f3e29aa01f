"""Arithmetic of the simulation-based calibration: ranks, the simultaneous band, and the table."""

import numpy as np
import pytest

from benchmarks.hull_ranks import DISTANCE, MissionRanks, band_of, kind_text, least_tail, rank_rows

NUMBER = 60


@pytest.fixture(scope="module")
def band():
    return band_of(NUMBER)


def test_uniform_ranks_leave_the_band_as_often_as_stated(band):
    """The simultaneous band of 95 % (Säilynoja et al. 2022)."""
    rng = np.random.default_rng(1)
    inside = np.mean([least_tail(rng.random(NUMBER)) >= band for _ in range(400)])
    assert 0.92 < inside < 0.98


@pytest.mark.parametrize("factor", [0.4, 2.0])
def test_deviations_that_are_wrong_by_a_factor_leave_it(band, factor):
    missions = drawn(factor)
    ((name, number, mean, size, inside, answer),) = rank_rows(missions, ["u"])
    assert (name, number, answer) == ("u", str(NUMBER), "no")
    assert float(size) == pytest.approx(factor, rel=0.25)
    assert float(mean) == pytest.approx(0.5, abs=0.15)
    assert float(inside.split(" / ")[0]) == pytest.approx(0.98 if factor < 1 else 0.38, abs=0.15)


def test_a_truth_above_the_estimate_has_a_high_rank():
    """Errors are the estimate less the truth."""
    (row,) = rank_rows([MissionRanks(seed, {"u": -1.0}) for seed in range(NUMBER)], ["u"])
    assert row[2] == "0.84"


def test_a_mission_without_a_current_does_not_count(band):
    (row,) = rank_rows([*drawn(1.0), MissionRanks(NUMBER, {"u": np.nan})], ["u"])
    assert row[1] == str(NUMBER)


def test_right_deviations_stay_in_it(band):
    rows = rank_rows(drawn(1.0), ["u", DISTANCE])
    assert [row[-1] for row in rows] == ["yes", "yes"]


def test_a_mission_without_values_is_counted_with_its_reason():
    lost = MissionRanks(NUMBER + 1, {}, failure="no steady flight to calibrate on")
    text = kind_text("calm", [*drawn(1.0), lost])
    assert f"{NUMBER + 1} missions: 1 without values" in text
    assert "- no steady flight to calibrate on" in text


def drawn(factor):
    """Return missions whose errors are the stated ones times a factor."""
    rng = np.random.default_rng(2)
    return [
        MissionRanks(seed, {"u": factor * rng.standard_normal()}, factor**2 * rng.chisquare(2))
        for seed in range(NUMBER)
    ]
