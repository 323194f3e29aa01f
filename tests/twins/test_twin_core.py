"""Parts of the twin experiments: changes of records, seams, impulses, budgets."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gliderhpc.errors import InputError
from gliderhpc.estimation.current_errors import (
    Budget,
    CurrentError,
    CurrentSettings,
    budget_text,
    fit_budget,
    read_budget,
)
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.platform import read_platform
from gliderhpc.studies import currents
from gliderhpc.studies.library.scores import rms
from gliderhpc.studies.library.turbulence.series import bridge_gaps, high_passed
from gliderhpc.twins.cases import (
    UNCERTAIN_COEFFICIENTS,
    RecordChanges,
    TwinCase,
    with_coefficient_errors,
    with_factors,
    world,
)
from gliderhpc.twins.recoverability import experiment as recoverability
from gliderhpc.twins.recoverability.experiment import crossing, identification_noise
from gliderhpc.twins.scoring import boundaries_of, jump_ratio, seam_ratio
from gliderhpc.twins.windows.experiment import strongest_stretch

STEP = 0.1


def _record(count=600):
    time = np.arange(count, dtype=float)
    level = np.zeros(count)
    return ProfileRecord(
        number=1, epoch=np.datetime64("2024-01-01", "ns"), time=time, roll=level.copy(), pitch=level - 0.4,
        heading=level + 6.28, depth=0.2 * time, battery_position=level.copy(), battery_rotation=level.copy(),
        ballast_volume=level.copy(), rudder=level.copy(),
    )  # fmt: skip


def _rng():
    return np.random.default_rng(1)


def test_a_record_faster_than_the_hull_s_own_is_recorded_that_fast():
    hull = read_platform("seaexplorer")
    case = TwinCase(hull, world(50.0), 1, EstimationSettings(), changes=RecordChanges(sample_interval=4.0))
    assert case.recorded_hull.sensors.sample_interval == 4.0
    slower = replace(case, changes=RecordChanges(sample_interval=60.0))
    assert slower.recorded_hull == hull


def test_offsets_are_added_and_heading_stays_in_its_turn():
    changed = RecordChanges(pitch_offset=1.0, heading_offset=1.0).apply(_record(), _rng())
    assert changed.pitch[0] == pytest.approx(-0.4 + math.radians(1.0))
    assert changed.heading[0] == pytest.approx(6.28 + math.radians(1.0) - 2.0 * math.pi)
    assert (changed.roll == 0.0).all()


@pytest.mark.parametrize("interval", [1.0, 4.0, 20.0])
def test_thinning_keeps_instants(interval):
    changed = RecordChanges(sample_interval=interval).apply(_record(), _rng())
    np.testing.assert_allclose(np.diff(changed.time), interval)
    np.testing.assert_allclose(changed.depth, 0.2 * changed.time)
    assert len(changed.ballast_volume) == len(changed.time)


def test_dropouts_are_seeded_and_leave_the_actuators():
    changes = RecordChanges(dropout=0.3)
    first, again = changes.apply(_record(), _rng()), changes.apply(_record(), _rng())
    np.testing.assert_array_equal(first.depth, again.depth)
    assert np.isnan(first.depth).mean() == pytest.approx(0.3, abs=0.06)
    np.testing.assert_array_equal(np.isnan(first.depth), np.isnan(first.heading))
    assert np.isfinite(first.battery_position).all()


def test_gaps_have_their_length_and_spacing():
    lost = np.isnan(RecordChanges(gap=30.0, gap_spacing=200.0).apply(_record(), _rng()).roll)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lost.astype(int), [0]])))
    assert list(np.diff(edges)[::2]) == [29, 29, 29]
    assert list(np.diff(edges[::2])) == [200, 200]


def test_no_change_changes_nothing():
    record = _record()
    changed = RecordChanges().apply(record, _rng())
    np.testing.assert_array_equal(changed.depth, record.depth)


def test_coefficient_errors_stay_within_their_share_and_touch_nothing_else():
    hull = read_platform("petrel-l")
    wrong = with_coefficient_errors(hull, _rng(), 0.15)
    ratios = [getattr(wrong.viscous, name) / getattr(hull.viscous, name) for name in UNCERTAIN_COEFFICIENTS[:11]]
    ratios += list(np.array(wrong.added_mass) / np.array(hull.added_mass))
    assert all(0.85 <= ratio <= 1.15 for ratio in ratios)
    assert np.std(ratios) > 0.03
    assert wrong.mass == hull.mass
    assert wrong.sensors == hull.sensors
    assert with_factors(hull, {}) == hull
    assert with_factors(hull, {"M_f3": 2.0}).added_mass == (*hull.added_mass[:2], 2.0 * hull.added_mass[2])


def _wave(count=6000):
    """A 2 Hz wave: the high-pass leaves it alone."""
    return np.sin(2.0 * np.pi * 2.0 * STEP * np.arange(count) + 0.3)


def test_seam_ratio_of_a_known_signal():
    """Three times as large within a second of every boundary: a ratio of three."""
    boundaries = np.arange(300, 6000, 300)
    distance = np.min(np.abs(np.arange(6000)[:, None] + 0.5 - boundaries), axis=1)
    signal = np.where(distance < 10.0, 3.0, 1.0) * _wave()
    assert seam_ratio(signal, boundaries, np.ones(6000, bool), STEP) == pytest.approx(3.0, rel=0.02)


def test_seam_ratio_is_one_where_there_is_no_seam():
    assert seam_ratio(_wave(), np.arange(300, 6000, 300), np.ones(6000, bool), STEP) == pytest.approx(1.0, rel=0.02)


def test_seam_ratio_leaves_unusable_stretches_out():
    signal, usable = _wave(), np.ones(6000, bool)
    signal[2000:2500] = 1e3
    usable[2000:2500] = False
    assert seam_ratio(signal, np.arange(300, 6000, 300), usable, STEP) == pytest.approx(1.0, rel=0.02)


def test_seam_ratio_without_boundaries_is_unknown():
    assert math.isnan(seam_ratio(_wave(), np.array([], dtype=int), np.ones(6000, bool), STEP))


def test_jump_ratio_of_a_known_signal():
    signal = np.tile([0.0, 1.0], 300)
    signal[301:] += 9.0
    # Steps of one everywhere, and one of 8 (9 - 1) up to the boundary.
    ours = jump_ratio(signal, np.array([301]), np.ones(600, bool))
    assert ours == pytest.approx(abs(signal[301] - signal[300]))


def test_boundaries_are_where_the_source_changes():
    np.testing.assert_array_equal(boundaries_of(np.array([0, 0, 1, 1, 2])), [2, 4])


def test_high_pass_takes_the_mean_and_shifts_nothing():
    high = high_passed(5.0 + _wave(), STEP)[500:-500]
    assert abs(high.mean()) < 0.01
    assert rms(high) == pytest.approx(rms(_wave()), rel=0.01)
    assert np.corrcoef(high, _wave()[500:-500])[0, 1] > 0.999


def test_bridging():
    usable = np.array([True, False, False, True])
    np.testing.assert_allclose(bridge_gaps(np.array([1.0, 9.0, 9.0, 4.0]), usable), [1.0, 2.0, 3.0, 4.0])
    assert (bridge_gaps(np.ones(3), np.zeros(3, bool)) == 0.0).all()


def test_strongest_stretch():
    signal = np.zeros(100)
    signal[60] = 1.0
    start = strongest_stretch(signal, np.ones(100, bool), 20)
    assert start <= 60 < start + 20


def test_floor_is_where_the_rate_stays_above():
    amplitudes = np.array([0.1, 0.2, 0.4, 0.8])
    assert crossing(amplitudes, [0.0, 1.0, 0.8, 1.0], 0.9) == pytest.approx(0.4 * math.sqrt(2.0))
    assert crossing(amplitudes, [1.0, 1.0, 1.0, 1.0], 0.9) == 0.1
    assert math.isnan(crossing(amplitudes, [0.0, 0.0, 0.0, 0.5], 0.9))


def test_the_fit_finds_the_terms_that_made_the_errors():
    rng = _rng()
    errors = []
    for _ in range(400):
        speed, way, course = rng.uniform(0.05, 0.4), rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi)
        along = np.array([np.cos(way), np.sin(way)])
        track = np.array([np.cos(course), np.sin(course)])
        wrong = rng.normal(0, 0.02) * track + rng.normal(0, 0.2 * speed) * along
        wrong += rng.normal(0, np.radians(5.0) * 0.3) * np.array([-track[1], track[0]])
        errors.append(CurrentError(tuple(speed * along), tuple(wrong), tuple(300.0 * track), 1000.0))
    fitted = fit_budget(errors)
    assert fitted.settings.axial_error == pytest.approx(0.02, rel=0.15)
    assert fitted.settings.relative_error == pytest.approx(0.2, rel=0.15)
    assert fitted.settings.heading_error == pytest.approx(5.0, rel=0.25)
    assert fitted.median_distance == pytest.approx(1.386, rel=0.15)


def test_a_budget_needs_three_twins():
    with pytest.raises(InputError, match="at least 3 twins"):
        fit_budget([CurrentError((0.1, 0.0), (0.01, 0.0), (1.0, 0.0), 1.0)])


def _budget():
    return Budget(
        platform="petrel-l", axial_error=0.0123, relative_error=0.05, heading_error=2.0, identification_noise=0.01,
        detection_floor=0.3, axial_offset_dive=0.1, axial_offset_climb=-0.1, axial_offset_rms=0.1,
        exact_axial_error=0.01, how={"axial_error": "by hand"},
    )  # fmt: skip


def test_budget_is_read_back(tmp_path):
    path = tmp_path / "budget.yaml"
    path.write_text(budget_text(_budget()), "utf-8")
    assert read_budget(path) == _budget()
    assert read_budget(path).current.axial_error == 0.0123


def test_a_budget_leaves_the_run_s_terms_of_fixes_and_actuation(monkeypatch, tmp_path):
    """It states the errors of the displacement; the settings of a run for its fixes and actuators remain."""
    path = tmp_path / "budget.yaml"
    path.write_text(budget_text(_budget()), "utf-8")
    given = CurrentSettings(actuation_error=0.7, fix_error=40.0, axial_error=0.5)
    monkeypatch.setattr(currents, "settings_of", lambda _: SimpleNamespace(current=given))
    model, remarks = currents._uncertainty_model(SimpleNamespace(budget=path), None, read_platform("petrel-l"))
    assert (model.current.actuation_error, model.current.fix_error, model.current.axial_error) == (0.7, 40.0, 0.0123)
    assert remarks == ()


def test_a_hull_whose_records_show_no_impulse_still_has_a_budget(tmp_path):
    """The terms of the current do not need the floor of the impulses; slow sensors have none."""
    preset = recoverability.BUDGET_PRESET
    terms = dict.fromkeys(
        ("axial_error", "relative_error", "heading_error", "axial_dive", "axial_climb", "axial_rms"), 0.1
    )
    errors = [{"preset": preset, "model": model, **terms} for model in recoverability.MODELS]
    floors = [{"preset": preset, "width": 1.0, "floor": math.nan}]
    budget = recoverability.make_budget(read_platform("seaexplorer"), {preset: {"noise": 0.01}}, floors, errors, 4)
    assert budget.detection_floor is None
    assert budget.how["detection_floor"] == "no impulse of 1 s of the grid is found in 90% of all cases"
    path = tmp_path / "budget.yaml"
    path.write_text(budget_text(budget), "utf-8")
    assert read_budget(path) == budget


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (": [", "not YAML"),
        ("platform: petrel-l\n", "axial_error: field required"),
        ("3", "the budget"),
    ],
)
def test_an_invalid_budget_file_is_refused(tmp_path, text, fault):
    path = tmp_path / "budget.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=fault):
        read_budget(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_budget(tmp_path / "absent.yaml")


def test_a_study_whose_quiet_twins_were_all_refused_says_why():
    rows = [{"kind": "refused", "preset": "paper", "refused": "profile 1: the filter rejects 80 % of the samples"}]
    with pytest.raises(InputError, match="preset paper: profile 1: the filter"):
        identification_noise(rows, "paper")
