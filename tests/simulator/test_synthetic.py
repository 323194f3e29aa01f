"""Synthetic mission: reproducible, consistent with its own truth, and readable like any other mission."""

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from geographiclib.geodesic import Geodesic

from gliderhpc.cli.simulate_mission import simulate
from gliderhpc.errors import InputError
from gliderhpc.flight.glider import Glider
from gliderhpc.observations import open_observations, write_observations
from gliderhpc.observations.truth import read_profile_truth, truth_path
from gliderhpc.platform import ballast_masses, read_platform
from gliderhpc.simulator import Scenario, read_scenario, simulate_mission, simulate_profile
from gliderhpc.simulator.disturbance import draw_disturbance
from gliderhpc.simulator.dive import Actuators, Helm
from gliderhpc.simulator.files import observation_variables
from gliderhpc.simulator.plan import plan_flight
from gliderhpc.simulator.sections import Disturbances, Steering

SHALLOW = read_scenario({"profiles": 3, "depth": 40.0, "steering": {"interval": 120.0}})
PERFECT = read_scenario({**SHALLOW.model_dump(), "sensors": {"factor": 0.0, "fix_deviation": 0.0}})

compiled = pytest.mark.compiled


@pytest.fixture(scope="module")
def petrel():
    return read_platform("petrel-l")


@pytest.fixture(scope="module")
def profile(petrel):
    return simulate_profile(petrel, SHALLOW, 1)


@pytest.fixture(scope="module")
def perfect(petrel):
    return simulate_profile(petrel, PERFECT, 1)


@pytest.fixture(scope="module")
def mission(petrel, tmp_path_factory):
    return simulate_mission(petrel, tmp_path_factory.mktemp("mission") / "twin.nc", scenario=SHALLOW, seed=1)


def without(scenario, **sections):
    """Change values inside the sections of a scenario."""
    content = scenario.model_dump()
    for section, values in sections.items():
        content[section] |= values
    return read_scenario(content)


# Reproducibility


@compiled
def test_same_seed_gives_the_same_bytes(petrel, mission, tmp_path):
    again = simulate_mission(petrel, tmp_path / "again.nc", scenario=SHALLOW, seed=1)
    assert again.path.read_bytes() == mission.path.read_bytes()
    assert again.truth_path.read_bytes() == mission.truth_path.read_bytes()


@compiled
def test_another_seed_gives_other_records(petrel, profile):
    other, _ = simulate_profile(petrel, SHALLOW, 2)
    assert not np.array_equal(other.depth[:100], profile[0].depth[:100])


@compiled
def test_a_profile_does_not_depend_on_the_others(petrel, mission):
    """Profile 2 alone has the very samples that it has in the mission; only time and place follow from the first."""
    alone, _ = simulate_profile(petrel, SHALLOW, 1, number=2)
    with open_observations(mission.path) as observations:
        within = observations.profile(2)
    np.testing.assert_array_equal(alone.time, within.time)
    np.testing.assert_array_equal(alone.depth, within.depth)
    np.testing.assert_allclose(alone.heading, within.heading, atol=1e-10)


@compiled
def test_sensor_noise_leaves_the_truth_as_it_is(profile, perfect):
    np.testing.assert_array_equal(profile[1].states, perfect[1].states)
    np.testing.assert_array_equal(profile[1].disturbances, perfect[1].disturbances)


# Records and truth


@compiled
def test_perfect_sensors_record_the_truth(perfect):
    record, truth = perfect
    np.testing.assert_array_equal(record.time, truth.time)
    np.testing.assert_array_equal(record.roll, truth.states[:, 0])
    np.testing.assert_array_equal(record.pitch, truth.states[:, 1])
    np.testing.assert_allclose(np.exp(1j * record.heading), np.exp(1j * truth.states[:, 2]), atol=1e-12)
    np.testing.assert_array_equal(record.depth, truth.states[:, 5])
    assert ((record.heading >= 0.0) & (record.heading <= 2.0 * np.pi)).all()


@compiled
def test_sensor_errors_are_those_of_the_platform(petrel, profile):
    record, truth = profile
    quantum = petrel.sensors.attitude_resolution_rad
    for name, column in (("roll", 0), ("pitch", 1)):
        values = getattr(record, name)
        np.testing.assert_allclose(values / quantum, np.rint(values / quantum), atol=1e-9)
        assert np.abs(values - truth.states[:, column]).max() <= 0.5 * quantum + 1e-12
    error = record.depth - truth.states[:, 5]
    assert error.std() == pytest.approx(petrel.sensors.depth_noise, rel=0.15)
    np.testing.assert_allclose(np.diff(record.time), petrel.sensors.sample_interval)


@compiled
def test_truth_drives_the_model_through_the_records(petrel, perfect):
    """The stored disturbance and actuators, integrated at the estimator's step, give the stored states (eq. 20)."""
    _, truth = perfect
    seconds = 120
    count = round(seconds / truth.step)
    middle = (np.arange(count) + 0.5) * truth.step
    position, rotation, volume = (np.interp(middle, truth.time, column) for column in truth.actuators.T)
    controls = np.column_stack([position, rotation, *ballast_masses(petrel, volume)])
    states = Glider(petrel).simulate(truth.states[0], controls, truth.disturbances[:count], truth.step)
    per_sample = round(1.0 / truth.step)
    difference = np.abs(states[::per_sample] - truth.states[: seconds + 1])
    assert np.degrees(difference[:, :3]).max() < 0.05
    assert difference[:, 3:6].max() < 0.01


@compiled
def test_truth_covers_the_record(profile):
    record, truth = profile
    assert len(truth.disturbances) * truth.step == pytest.approx(truth.duration)
    assert record.time[-1] == pytest.approx(truth.duration)
    assert truth.states[:, 5].max() > SHALLOW.depth
    assert truth.states[0, 5] == SHALLOW.start_depth
    assert truth.states[-1, 5] <= SHALLOW.start_depth


@compiled
def test_impulses_are_in_the_yaw_moment_alone(petrel):
    scenario = without(SHALLOW, disturbances={"impulse_interval": 60.0, "slow_rms": (0.0,) * 6})
    _, truth = simulate_profile(petrel, scenario, 4)
    assert truth.impulses
    assert not truth.disturbances[:, :5].any()
    time = (np.arange(len(truth.disturbances)) + 0.5) * truth.step
    expected = sum(i.amplitude * np.exp(-0.5 * ((time - i.time) / i.width) ** 2) for i in truth.impulses)
    # What peaks just after the end of the dive still reaches into it.
    inside = time < truth.duration - 20.0
    np.testing.assert_allclose(truth.disturbances[inside, 5], expected[inside], atol=2e-3)
    for impulse in truth.impulses:
        assert 0.6 <= abs(impulse.amplitude) <= 3.0
        assert 1.2 <= impulse.width <= 2.5


@compiled
def test_actuators_lag_what_is_recorded(petrel, profile):
    record, truth = profile
    start = np.flatnonzero(np.diff(record.ballast_volume))[0]
    ramp = slice(start + 5, start + 15)
    slope = np.diff(record.ballast_volume[ramp]).mean()
    behind = (record.ballast_volume - truth.actuators[:, 2])[ramp]
    np.testing.assert_allclose(behind / slope, SHALLOW.actuation.lag, rtol=0.02)
    late = slice(start + 40, None)
    np.testing.assert_allclose(truth.actuators[late, 2], record.ballast_volume[late], rtol=1e-9)
    assert np.mean(record.battery_rotation == 0.0) > 0.5


# Current and fixes


@compiled
def test_a_uniform_current_only_displaces(petrel):
    """A uniform steady current changes neither attitude nor depth (docs/theory/model.md), but it moves the glider."""
    still, moved = (
        simulate_profile(petrel, without(PERFECT, current={"speed": speed}), 1) for speed in ((0.0, 0.0), (0.4, 0.4))
    )
    for name in ("time", "roll", "pitch", "heading", "depth", "battery_rotation"):
        np.testing.assert_array_equal(getattr(still[0], name), getattr(moved[0], name))
    np.testing.assert_array_equal(still[1].states, moved[1].states)
    assert np.hypot(*moved[1].current) == pytest.approx(0.4)
    apart = Geodesic.WGS84.Inverse(*still[1].exit, *moved[1].exit)["s12"]
    drifted = moved[1].duration + (moved[1].epoch - np.datetime64(PERFECT.start)) / np.timedelta64(1, "s")
    assert apart == pytest.approx(0.4 * drifted, rel=1e-3)


def displacement(before, after):
    line = Geodesic.WGS84.Inverse(before.latitude, before.longitude, after.latitude, after.longitude)
    azimuth = np.radians(line["azi1"])
    return line["s12"] * np.array([np.cos(azimuth), np.sin(azimuth)])


@compiled
@pytest.mark.parametrize("deviation", [0.0, 5.0])
def test_fixes_agree_with_displacement_and_current(petrel, deviation):
    scenario = without(SHALLOW, sensors={"fix_deviation": deviation})
    record, truth = simulate_profile(petrel, scenario, 3)
    elapsed = (record.exit_fix.time - record.entry_fix.time) / np.timedelta64(1, "s")
    assert elapsed == truth.duration + 2 * scenario.surface.fix_delay
    expected = truth.displacement + elapsed * truth.current
    error = displacement(record.entry_fix, record.exit_fix) - expected
    assert np.hypot(*error) <= 0.05 + 4.0 * np.sqrt(2.0) * deviation
    assert len(record.surface_fixes_before) == len(record.surface_fixes_after) == 2


@compiled
def test_profiles_are_strung_together(mission):
    """The drift between one dive's exit and the next one's entry is that of the currents on either side."""
    first, second = (read_profile_truth(mission.truth_path, number) for number in (1, 2))
    line = Geodesic.WGS84.Inverse(
        float(first.exit_latitude),
        float(first.exit_longitude),
        float(second.entry_latitude),
        float(second.entry_longitude),
    )
    elapsed = float((second.entry_time - first.exit_time) / np.timedelta64(1, "s"))
    speeds = [float(np.hypot(truth.current_north, truth.current_east)) for truth in (first, second)]
    assert 360.0 <= elapsed <= 842.0
    assert line["s12"] <= max(speeds) * elapsed + 0.1


# Files


@compiled
def test_mission_opens_without_faults(petrel, mission):
    with open_observations(mission.path) as observations:
        assert observations.profile_numbers == [1, 2, 3]
        assert observations.faults == {}
        assert observations.warnings == ()
        assert observations.platform_name == petrel.name
        for number in observations.profile_numbers:
            record = observations.profile(number)
            assert record.notes == ()
            assert len(record.surface_fixes_before) >= 2
            assert len(record.surface_fixes_after) >= 2
            assert observations.duration(number) == mission.profiles[number - 1].duration


@compiled
def test_profiles_are_found_where_they_are_not_numbered(petrel, mission, tmp_path):
    with xr.open_dataset(mission.path) as dataset:
        numbers = dataset["profile"].values
        dataset.drop_vars("profile").to_netcdf(tmp_path / "plain.nc")
    with open_observations(tmp_path / "plain.nc") as observations:
        assert observations.profile_numbers == [1, 2, 3]
        assert observations.sample_count(2) == pytest.approx(np.count_nonzero(numbers == 2), abs=40)


@compiled
def test_truth_file_holds_what_was_true(petrel, mission):
    _, truth = simulate_profile(petrel, SHALLOW, 1, number=2)
    stored = read_profile_truth(mission.truth_path, 2)
    np.testing.assert_allclose(stored.B_cr, truth.disturbances[:, 5], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(stored.pitch, np.degrees(truth.states[:, 1]), rtol=1e-6)
    np.testing.assert_allclose(stored.X, truth.states[:, 3], rtol=1e-6)
    assert float(stored.current_east) == truth.current[1]
    np.testing.assert_allclose(stored.impulse_amplitude, [impulse.amplitude for impulse in truth.impulses])
    assert stored.sizes["truth_time"] == len(truth.disturbances)
    assert (np.diff(stored.truth_time.values) == np.timedelta64(100, "ms")).all()
    assert stored.attrs["seed"] == 1
    assert read_scenario(json.loads(stored.attrs["scenario"])) == SHALLOW


@compiled
def test_truth_without_impulses_can_be_written(petrel, tmp_path):
    scenario = without(SHALLOW.replaced({"profiles": 1}), disturbances={"impulse_interval": None})
    summary = simulate_mission(petrel, tmp_path / "calm.nc", scenario=scenario)
    assert summary.profiles[0].impulses == 0
    assert read_profile_truth(summary.truth_path, 1).sizes["impulse"] == 0


@compiled
def test_truth_that_cannot_be_written_is_one_line(petrel, tmp_path):
    (tmp_path / "twin.truth.nc").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        simulate_mission(petrel, tmp_path / "twin.nc", scenario=SHALLOW.replaced({"profiles": 1}))
    assert [path.name for path in tmp_path.iterdir()] == ["twin.truth.nc"]


@compiled
def test_truth_of_an_absent_profile_is_refused(mission, tmp_path):
    with pytest.raises(InputError, match="no truth for profile 9"):
        read_profile_truth(mission.truth_path, 9)
    (tmp_path / "text.truth.nc").write_text("not netCDF")
    with pytest.raises(InputError, match="cannot be read"):
        read_profile_truth(tmp_path / "text.truth.nc", 1)


@compiled
def test_records_survive_the_file(petrel, profile, tmp_path):
    record, _ = profile
    attributes = {"platform": petrel.name, "mission": "m", "source": "s"}
    path = write_observations(
        observation_variables([replace(record, number=7)]), tmp_path / "o.nc", attributes=attributes
    )
    with open_observations(path) as observations:
        read = observations.profile(7)
    assert read.epoch == record.epoch
    for name in ("time", "roll", "pitch", "depth", "battery_position", "battery_rotation", "ballast_volume"):
        np.testing.assert_allclose(getattr(read, name), getattr(record, name), atol=1e-10)


# Every hull, and refusals


@compiled
@pytest.mark.parametrize("name", ["petrel-l", "seawing", "slocum", "seaexplorer", "seaglider"])
def test_every_hull_flies_the_default_scenario(name):
    platform = read_platform(name)
    record, truth = simulate_profile(platform, Scenario(), 0)
    assert truth.duration >= 2400.0
    assert np.isfinite(truth.states).all()
    assert 200.0 < truth.states[:, 5].max() < 210.0
    assert np.degrees(np.abs(truth.states[:, 0])).max() < 30.0
    assert (np.diff(record.time) == platform.sensors.sample_interval).all()


@compiled
@pytest.mark.parametrize("interval", [60.0, 240.0])
def test_the_helm_brings_the_dive_onto_its_course(petrel, interval):
    steering = {"courses": (350.0,), "interval": interval, "longest_turn": interval}
    calm = without(Scenario(), disturbances={"impulse_interval": None}, steering=steering)
    _, truth = simulate_profile(petrel, calm, 5)
    start, bottom = truth.states[0, 2], truth.states[int(np.argmax(truth.states[:, 5])), 2]
    assert abs(np.degrees(start) - 350.0) > calm.steering.dead_band
    assert abs(np.degrees(bottom) - 350.0) < calm.steering.dead_band + 2.0


@compiled
def test_default_net_masses_fight_the_depth_slope(petrel):
    plan = plan_flight(Glider(petrel), Scenario().replaced({"depth": 800.0}))
    assert 0.6 < plan.dive.glide.net_mass < 0.7
    assert -0.25 < plan.climb.glide.net_mass < -0.15


@compiled
@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"actuation": {"dive_net_mass": 0.09}}, r"stalls at 177 m with \+0\.090 kg and cannot reach 200 m"),
        ({"actuation": {"pitch": 5.0}}, "no steady glide at a pitch of -5.0 degree.*minimum glide angle is 15"),
        (
            {
                "actuation": {"dive_net_mass": 0.11},
                "disturbances": {"slow_rms": (1.0, 0, 0, 0, 0, 0), "slow_periods": (1e6, 1e6)},
            },
            "does not reach 200 m within",
        ),
        (
            {
                "actuation": {"climb_net_mass": -0.05},
                "disturbances": {"slow_rms": (1.0, 0, 0, 0, 0, 0), "slow_periods": (1e6, 1e6)},
            },
            "does not return to the surface within",
        ),
        ({"disturbances": {"slow_rms": (0, 0, 0, 0, 1e9, 0)}}, "loses stable flight"),
    ],
)
def test_scenarios_that_cannot_be_flown_are_refused(petrel, values, message):
    with pytest.raises(InputError, match=message):
        simulate_profile(petrel, read_scenario(values), 0)


@compiled
def test_unstable_hull_is_refused(petrel):
    viscous = petrel.viscous.model_copy(update={"K_MY": -400.0})
    with pytest.raises(InputError, match="does not glide stably"):
        simulate_profile(petrel.model_copy(update={"viscous": viscous}), Scenario(), 0)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"depth": -3}, "depth is -3"),
        ({"wind": 3}, "unknown key 'wind'; keys are name, profiles"),
        ({"current": {"speed": (0.4, 0.1)}}, r"current\.speed.*exceeds the upper limit"),
        ({"surface": {"fixes": 9}}, "must be longer"),
        ({"integration": {"truth_step": 0.12}}, "truth_step must be a multiple of step"),
    ],
)
def test_bad_scenario_is_refused_in_one_line(values, message):
    with pytest.raises(InputError, match=message) as caught:
        read_scenario(values)
    assert "\n" not in str(caught.value)


# Parts


def test_slow_disturbance_has_its_rms():
    settings = Disturbances(impulse_interval=None, slow_periods=(600.0, 700.0))
    draws = [draw_disturbance(settings, 1e5, np.random.default_rng(seed)).sampled(20_000, 5.0) for seed in range(20)]
    rms = np.sqrt(np.mean(np.square(draws), axis=(0, 1)))
    np.testing.assert_allclose(rms, settings.slow_rms, rtol=0.1)


def test_impulses_come_as_often_as_asked():
    impulses = draw_disturbance(Disturbances(), 90_000.0, np.random.default_rng(0)).impulses
    assert len(impulses) == pytest.approx(1000, abs=100)
    assert np.mean([impulse.amplitude > 0.0 for impulse in impulses]) == pytest.approx(0.5, abs=0.06)


def test_actuators_follow_a_ramp_exactly():
    """``lag * d(actual)/dt = commanded - actual`` under a ramp: the textbook solution."""
    scenario = Scenario()
    rates = np.array([0.01, 0.1, 1e-5])
    actuators = Actuators(np.zeros(3), rates, scenario)
    path = np.vstack([actuators.advance(np.array([1.0, 1.0, 1.0])) for _ in range(3)])
    time = (np.arange(len(path)) + 0.5) * scenario.integration.step
    lag = scenario.actuation.lag
    expected = time - lag * (1.0 - np.exp(-time / lag))
    np.testing.assert_allclose(path, expected[:, None] * rates, rtol=1e-9)
    np.testing.assert_allclose(actuators.commanded, 3.0 * rates)


def test_helm_turns_the_short_way_and_no_longer_than_needed():
    helm = Helm(Steering(), course=np.radians(350.0))
    assert helm.rotation(59.0, np.radians(20.0), 0.02) == 0.0
    assert helm.rotation(60.0, np.radians(20.0), 0.02) == pytest.approx(np.radians(-20.0))
    needed = 60.0 + np.radians(30.0) / 0.02
    assert helm.rotation(needed - 1.0, np.radians(350.0), 0.02) < 0.0
    assert helm.rotation(needed + 1.0, np.radians(350.0), 0.02) == 0.0


def test_helm_leaves_small_errors_and_reversed_hulls_alone():
    helm = Helm(Steering(), course=0.0)
    assert helm.rotation(60.0, np.radians(11.0), 0.02) == 0.0
    assert helm.rotation(659.0, np.radians(90.0), 0.02) == 0.0
    assert helm.rotation(660.0, np.radians(90.0), -0.002) > 0.0
    assert helm.rotation(719.0, np.radians(90.0), -0.002) > 0.0
    assert helm.rotation(720.0, np.radians(90.0), -0.002) == 0.0
    assert Helm(Steering(), course=0.0).rotation(60.0, 1.0, 0.0) == 0.0


def test_truth_lies_next_to_the_observations(tmp_path):
    assert truth_path(tmp_path / "OUT.nc") == tmp_path / "OUT.truth.nc"


# Command line


@compiled
def test_command_writes_both_files(tmp_path):
    out = tmp_path / "twin.nc"
    arguments = [str(out), "--platform", "seawing", "--profiles", "2", "--seed", "3", "--depth", "30"]
    result = CliRunner().invoke(simulate, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    assert "2 profiles" in result.stdout
    assert "profile 2:" in result.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"twin.nc", "twin.truth.nc"}


@compiled
@pytest.mark.parametrize(
    ("name", "message"),
    [("twin.txt", "ends in .nc"), ("a.truth.nc", "for the truth"), ("no/twin.nc", "does not exist")],
)
def test_bad_file_names_are_refused(petrel, tmp_path, name, message):
    with pytest.raises(InputError, match=message):
        simulate_mission(petrel, tmp_path / name)
