"""Scenarios: files, simulated worlds, and missions made in parts by any number of workers."""

from datetime import datetime

import numpy as np
import pytest
import xarray as xr
from geographiclib.geodesic import Geodesic
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.missions import program

from gliderhpc.errors import InputError
from gliderhpc.flight.coefficients import COEFFICIENTS, with_errors
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.executors import local_executor
from gliderhpc.mission.warm import warm_simulator
from gliderhpc.observations import open_observations
from gliderhpc.observations.truth import read_profile_truth
from gliderhpc.platform import read_platform
from gliderhpc.simulator import (
    Scenario,
    load_scenario,
    read_scenario,
    shipped_scenarios,
    simulate_mission,
    simulate_profile,
)
from gliderhpc.simulator.hull import true_hull
from gliderhpc.simulator.mission import PartJob, make_part, part_path, parts_in_order
from gliderhpc.simulator.ocean import current_profile
from gliderhpc.simulator.plan import courses, plan_flight
from gliderhpc.simulator.sections import Current

compiled = pytest.mark.compiled

QUIET = {"disturbances": {"slow_rms": (0.0,) * 6, "impulse_interval": None}}
PERFECT = {"factor": 0.0, "fix_deviation": 0.0}
SHEARED = {"speed": (0.1, 0.1), "surface_rms": 0.2, "mode_rms": 0.1, "fine_rms": 0.03}
GUSTY = {"kind": "cascade", "rms": 0.03}


@pytest.fixture(scope="module")
def petrel():
    return read_platform("petrel-l")


def small(**sections):
    """Read a scenario of two shallow profiles."""
    return read_scenario({"profiles": 2, "depth": 40.0, "steering": {"interval": 120.0}, **sections})


# Files


def test_shipped_scenarios_are_the_promised_ones():
    assert set(shipped_scenarios()) >= {"calm", "harsh", "fouling", "paper", "impulses"}
    for name in shipped_scenarios():
        assert load_scenario(name).name == name


def test_default_scenario_is_the_file_impulses():
    assert load_scenario("impulses") == Scenario()


def test_paper_scenario_is_that_of_the_paper():
    scenario = load_scenario("paper")
    assert scenario.profiles == scenario.fouling.profiles == 565
    assert (scenario.depth - scenario.depth_spread, scenario.depth + scenario.depth_spread) == (610.0, 820.0)


def test_scenario_file_needs_only_what_differs(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("name: mine\ndepth: 60\ngusts: {kind: gaussian}\n")
    scenario = load_scenario(path)
    assert (scenario.name, scenario.depth, scenario.gusts.kind) == ("mine", 60.0, "gaussian")
    assert scenario.current == Scenario().current
    path.write_text("start: 2024-02-03T01:00:00+01:00\n")
    assert load_scenario(path).start == datetime(2024, 2, 3), "UTC"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("deph: 60", "unknown key 'deph', did you mean 'depth'.; keys are name"),
        ("gusts: {knd: cascade}", "unknown key 'gusts.knd', did you mean 'kind'"),
        ("gusts: {kind: storm}", "gusts.kind is 'storm': input should be 'none', 'cascade' or 'gaussian'"),
        ("gusts: {outer: 1.0}", "gusts: outer must be at least four times inner"),
        ("depth: 50\ndepth_spread: 40", "leaves less than 15 m"),
        ("sensors: {pitch_offset: 400}", "sensors.pitch_offset is 400: input should be less than or equal to 30"),
        ("disturbances: {slow_terms: 1000000}", "slow_terms is 1000000: input should be less than or equal to 1000"),
        ("start: 2200-01-01", "input should be less than 2099-01-01T00:00:00"),
        ("- 1", "not a scenario file"),
        ("a: [", "not YAML at line"),
    ],
)
def test_bad_scenario_files_are_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        load_scenario(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_absent_scenarios_are_refused(tmp_path):
    with pytest.raises(InputError, match="unknown scenario 'papr', did you mean 'paper'"):
        load_scenario("papr")
    with pytest.raises(InputError, match="this scenario file cannot be read"):
        load_scenario(tmp_path / "no.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(InputError, match="not a text file"):
        load_scenario(tmp_path / "binary.yaml")


# Any scenario


def scenarios():
    """Draw scenarios of one shallow profile with everything that can be switched on."""
    rms = st.floats(0.0, 0.3)
    offset = st.floats(-3.0, 3.0)
    return st.builds(
        lambda depth, spread, gust, current, fouling, coefficients, sensors, slow: read_scenario(
            {
                "profiles": 1, "depth": depth, "depth_spread": spread, "current": current, "fouling": fouling,
                "coefficients": {"spread": coefficients}, "sensors": sensors, "steering": {"interval": 120.0},
                "disturbances": {"slow_rms": (slow, 0.0, slow, 0.0, 0.1 * slow, 0.0)},
                "gusts": {"kind": gust[0], "rms": gust[1], "inner": gust[2]},
            }
        ),
        depth=st.floats(25.0, 60.0),
        spread=st.floats(0.0, 10.0),
        gust=st.tuples(st.sampled_from(["none", "cascade", "gaussian"]), st.floats(0.0, 0.05), st.floats(0.4, 8.0)),
        current=st.fixed_dictionaries(
            {"surface_rms": rms, "mode_rms": rms, "fine_rms": st.floats(0.0, 0.05), "evolution": st.floats(1.0, 50.0)}
        ),
        fouling=st.fixed_dictionaries(
            {"profiles": st.just(1), "drag": st.floats(-0.1, 0.5), "lift": st.floats(-0.2, 0.2),
             "climb_share": st.floats(0.0, 1.0), "net_mass": st.floats(-0.02, 0.02)}
        ),
        coefficients=st.sampled_from([0.0, 0.05, 0.15]),
        sensors=st.fixed_dictionaries(
            {"factor": st.floats(0.0, 2.0), "roll_offset": offset, "pitch_offset": offset, "heading_offset": offset,
             "dropouts": st.floats(0.0, 30.0), "outliers": st.floats(0.0, 60.0)}
        ),
        slow=st.floats(0.0, 0.1),
    )  # fmt: skip


@pytest.mark.long
@compiled
@settings(max_examples=40, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(scenario=scenarios(), seed=st.integers(0, 2**31), number=st.integers(1, 3))
def test_any_scenario_is_finite_and_physical(scenario, seed, number):
    platform = read_platform("petrel-l")
    record, truth = simulate_profile(platform, scenario, seed, number=number)
    assert (np.diff(record.time) > 0.0).all()
    for name in ("states", "disturbances", "actuators", "water", "shear", "current"):
        assert np.isfinite(getattr(truth, name)).all(), name
    assert np.hypot(truth.states[:, 6], truth.states[:, 8]).max() < 1.0
    assert np.degrees(np.abs(truth.states[:, :2])).max() < 60.0
    assert truth.states[:, 5].min() > -0.5
    assert truth.states[:, 5].max() < scenario.depth + scenario.depth_spread + 25.0
    for name, limit in (("roll", np.pi), ("pitch", 0.5 * np.pi)):
        assert np.nanmax(np.abs(getattr(record, name))) <= limit
    assert np.nanmin(record.heading) >= 0.0
    assert np.nanmax(record.heading) <= 2.0 * np.pi
    assert np.nanmin(record.depth) >= -10.0
    assert -90.0 < truth.exit[0] < 90.0
    fixes = [*record.surface_fixes_before, *record.surface_fixes_after]
    assert (np.diff([fix.time for fix in fixes]) > np.timedelta64(0, "s")).all()


@compiled
@settings(max_examples=15, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(scenario=scenarios(), seed=st.integers(0, 2**31))
def test_without_noise_the_records_are_the_truth(scenario, seed):
    scenario = scenario.replaced({"sensors": PERFECT})
    record, truth = simulate_profile(read_platform("petrel-l"), scenario, seed)
    np.testing.assert_array_equal(record.roll, truth.states[:, 0])
    np.testing.assert_array_equal(record.pitch, truth.states[:, 1])
    np.testing.assert_allclose(np.exp(1j * record.heading), np.exp(1j * truth.states[:, 2]), atol=1e-12)
    np.testing.assert_array_equal(record.depth, truth.states[:, 5])
    line = Geodesic.WGS84.Inverse(*truth.entry, *truth.exit)
    over_ground = truth.displacement + truth.duration * truth.current
    assert line["s12"] == pytest.approx(np.hypot(*over_ground), abs=0.01)


# Currents, gusts and hulls


def test_current_profile_has_its_slopes():
    settings_ = Current(**SHEARED)
    current = current_profile(settings_, 3, 7, depth=300.0, duration=1e4)
    table = current.table
    for values, slopes in ((table[:, :2], table[:, 2:4]), (table[:, 4:6], table[:, 6:8])):
        centred = (values[2:] - values[:-2]) / (2.0 * current.spacing)
        np.testing.assert_allclose(slopes[1:-1], centred, atol=0.05 * np.abs(slopes).max())


def test_current_profile_has_its_strength():
    """Over many seeds the mean square at the surface is the sum of the parts'."""
    settings_ = Current(speed=(0.0, 0.0), surface_rms=0.2, mode_rms=0.1, modes=1, fine_rms=0.05)
    surface = [current_profile(settings_, seed, 1, depth=50.0, duration=1e4).table[0, :2] for seed in range(400)]
    assert np.sqrt(np.mean(np.square(surface))) == pytest.approx(np.sqrt(0.2**2 + 0.1**2 + 0.05**2), rel=0.08)


def test_slow_current_goes_on_from_profile_to_profile():
    settings_ = Current(speed=(0.0, 0.0), surface_rms=0.2, mode_rms=0.1, evolution=5.0)
    first, second = (current_profile(settings_, 3, n, depth=300.0, duration=1e4) for n in (4, 5))
    at_end = first.table[:, :4] + 1e4 * first.table[:, 4:]
    np.testing.assert_allclose(at_end, second.table[:, :4], atol=1e-12)
    assert np.abs(first.table[:, 4:6]).max() > 0.0


@compiled
def test_truth_knows_the_water_that_was_met(petrel):
    _, truth = simulate_profile(petrel, small(current=SHEARED, gusts=GUSTY, sensors=PERFECT, **QUIET), 5)
    assert truth.water[:, 2].std() > 0.01
    across = np.array([np.cos(truth.course + np.pi / 2), np.sin(truth.course + np.pi / 2)])
    met = truth.water[:, :2] + truth.water[:, 2:] * across
    mean = np.trapezoid(met, truth.time, axis=0) / truth.duration
    np.testing.assert_allclose(mean, truth.current, atol=2e-4)
    dive = truth.time < 0.4 * truth.duration
    profile = np.column_stack([np.interp(truth.states[dive, 5], truth.levels, c) for c in truth.shear.T])
    assert np.abs(profile - truth.water[dive, :2]).max() < 0.05


@compiled
def test_the_true_current_is_that_of_the_water_below_the_dive_as_well(petrel):
    """The levels of a mission reach to its deepest dive, and a shallow dive has the current of all of them."""
    scenario = load_scenario("paper").replaced({"depth": 120.0, "depth_spread": 100.0})
    _, truth = simulate_profile(petrel, scenario, 1)
    below = truth.levels > truth.states[:, 5].max() + 60.0
    assert below.sum() >= 3
    assert (np.abs(np.diff(truth.shear[below], axis=0)).max(axis=1) > 0.0).all()


def test_shear_and_gusts_act_in_yaw_through_sideslip(petrel):
    """Nothing is added to the equations, yet the hull slips sideways and turns: eq. 41's moment arises by itself."""
    calm = small(sensors=PERFECT, **QUIET)
    rough = calm.replaced({"current": SHEARED, "gusts": GUSTY})
    still, moved = (simulate_profile(petrel, scenario, 5)[1] for scenario in (calm, rough))
    assert not still.disturbances.any()
    assert np.abs(moved.disturbances[:, 1]).max() > 0.5
    seconds = slice(20, 300)
    assert moved.states[seconds, 7].std() > 2.0 * still.states[seconds, 7].std()


@compiled
def test_fouling_slows_the_dive_more_than_the_climb(petrel):
    fouling = {"profiles": 10, "drag": 0.4, "climb_share": 0.25, "net_mass": 0.01}
    scenario = small(fouling=fouling, current={"speed": (0.0, 0.0)}, **QUIET)
    clean, fouled = (simulate_profile(petrel, scenario, 1, number=number)[1] for number in (1, 11))
    k = petrel.viscous.K_D0
    assert clean.coefficients["K_D0"] == (k, k)
    assert fouled.coefficients["K_D0"] == pytest.approx((1.4 * k, 1.1 * k))
    assert (clean.net_mass, fouled.net_mass) == pytest.approx((0.0, 0.01))
    slower = [
        np.median(np.diff(truth.states[:, 5])[slice(*span)])
        for truth in (clean, fouled) for span in ((100, 180), (-180, -100))
    ]  # fmt: skip
    assert slower[2] < slower[0]
    assert slower[3] > slower[1]


def test_fouling_grows_in_its_own_time(petrel):
    """The first profiles of a cut mission are those of the whole."""
    scenario = read_scenario({"fouling": {"profiles": 100, "drag": 0.5, "exponent": 2.0}})
    grown = [true_hull(petrel, scenario, 0, n).dive.viscous.K_D0 / petrel.viscous.K_D0 - 1.0 for n in (1, 51, 101, 900)]
    np.testing.assert_allclose(grown, [0.0, 0.125, 0.5, 0.5])


def test_coefficient_errors_are_drawn_once_a_mission(petrel):
    scenario = small(coefficients={"spread": 0.15})
    hulls = [true_hull(petrel, scenario, 4, number).dive for number in (1, 2)]
    assert hulls[0] == hulls[1]
    ratios = np.array([getattr(hulls[0].viscous, n) / getattr(petrel.viscous, n) for n in COEFFICIENTS if n != "K_L0"])
    assert (np.abs(ratios - 1.0) <= 0.15).all()
    assert len(np.unique(np.round(ratios, 12))) == len(ratios)
    assert true_hull(petrel, scenario, 5, 1).dive != hulls[0]
    assert Glider(hulls[0]).hull.mass_v != Glider(petrel).hull.mass_v


def test_hull_that_no_draw_saves_is_refused(petrel):
    unstable = petrel.model_copy(update={"viscous": petrel.viscous.model_copy(update={"K_MY": -400.0})})
    with pytest.raises(InputError, match="no draw of its coefficients within 15% glides stably"):
        with_errors(unstable, 0.15, 0)


# Sensors


@compiled
def test_offsets_gaps_and_false_samples_are_in_the_records_alone(petrel):
    faulty = {**PERFECT, "roll_offset": 1.0, "pitch_offset": -2.0, "heading_offset": 3.0, "dropouts": 40.0,
              "outliers": 60.0}  # fmt: skip
    (clean, truth), (faulted, same) = (
        simulate_profile(petrel, small(sensors=sensors), 2) for sensors in (PERFECT, faulty)
    )
    np.testing.assert_array_equal(truth.states, same.states)
    for name, offset in (("roll", 1.0), ("pitch", -2.0), ("heading", 3.0)):
        difference = np.degrees(getattr(faulted, name) - getattr(clean, name))
        assert np.nanmedian(difference) == pytest.approx(offset)
        assert 0.0 < np.isnan(difference).mean() < 0.6
        assert np.nanmax(np.abs(np.mod(difference - offset + 180.0, 360.0) - 180.0)) < 45.0
    assert np.isnan(faulted.depth).any()
    np.testing.assert_array_equal(faulted.ballast_volume, clean.ballast_volume)


@compiled
def test_faulty_mission_opens_and_is_usable(petrel, tmp_path):
    scenario = small(sensors={"dropouts": 20.0, "outliers": 20.0})
    path = simulate_mission(petrel, tmp_path / "faulty.nc", scenario=scenario, seed=2).path
    with open_observations(path) as observations:
        assert observations.profile_numbers == [1, 2]
        assert observations.faults == {}
        assert np.isnan(observations.profile(1).pitch).any()


# Waypoints


def test_courses_lead_to_the_waypoints(petrel):
    origin, target = (18.0, 115.0), (18.0, 115.06)
    content = {"origin": origin, "depth": 200.0, "steering": {"waypoints": [target, origin], "reach": 700.0}}
    scenario = read_scenario({**content, "current": {"speed": (0.0, 0.0)}})
    plan = plan_flight(Glider(petrel), scenario)
    steered = courses(scenario, plan, 0, 20)
    legs = Geodesic.WGS84.Inverse(*origin, *target)["s12"] / plan.nominal_range
    there = int(legs)
    np.testing.assert_allclose(steered[: there - 1], 90.0, atol=0.1)
    assert 260.0 < steered[there + 2] < 280.0


@compiled
def test_glider_comes_by_its_waypoint(petrel, tmp_path):
    """In a current of a third of its speed, steering by battery rotation alone, it follows the planned track."""
    target = (18.014, 115.010)
    steering = {"waypoints": [target], "interval": 120.0, "longest_turn": 120.0, "reach": 100.0, "initial_error": 10.0}
    scenario = read_scenario(
        {"profiles": 8, "depth": 60.0, "steering": steering, "current": {"speed": (0.05, 0.1), "surface_rms": 0.05}}
    )
    summary = simulate_mission(petrel, tmp_path / "way.nc", scenario=scenario, seed=2)
    ends = [read_profile_truth(summary.truth_path, profile.number) for profile in summary.profiles]
    away = [Geodesic.WGS84.Inverse(float(end.exit_latitude), float(end.exit_longitude), *target)["s12"] for end in ends]
    assert min(away) < 450.0
    assert away[0] > 1300.0


# Missions in parts


@pytest.fixture(scope="module")
def rough():
    return small(current=SHEARED, gusts=GUSTY, depth_spread=5.0, coefficients={"spread": 0.1}).replaced({"profiles": 5})


@pytest.mark.long
@compiled
def test_bytes_do_not_depend_on_the_workers(petrel, rough, tmp_path):
    """In this process, on one worker and on two: the same observations and the same truth."""
    files = []
    for workers in (0, 1, 2):
        path = tmp_path / f"by_{workers}.nc"
        with local_executor(workers, warm_simulator) as executor:
            summary = simulate_mission(petrel, path, scenario=rough, seed=9, run=executor.run)
        files.append((path.read_bytes(), summary.truth_path.read_bytes()))
    assert files[0] == files[1] == files[2]
    assert {path.name for path in tmp_path.iterdir()} == {
        f"by_{n}{end}" for n in range(3) for end in (".nc", ".truth.nc")
    }


@compiled
def test_parts_are_taken_in_order_whatever_comes_first(petrel, rough, tmp_path):
    jobs = [PartJob(number, 75.0, petrel, rough, 9, str(tmp_path)) for number in (1, 2, 3)]

    def backwards(function, jobs):
        return map(function, reversed(jobs))

    assert [record.number for record, _ in parts_in_order(jobs, backwards)] == [1, 2, 3]
    assert not any(tmp_path.iterdir())
    assert make_part(jobs[1]) == 2
    assert part_path(str(tmp_path), 2).exists()


@compiled
def test_first_profiles_are_those_of_the_whole_mission(petrel, rough, tmp_path):
    whole, cut = (
        simulate_mission(petrel, tmp_path / f"{n}.nc", scenario=rough.replaced({"profiles": n}), seed=9) for n in (4, 2)
    )
    assert cut.profiles == whole.profiles[:2]
    for number in (1, 2):
        a, b = (read_profile_truth(summary.truth_path, number) for summary in (whole, cut))
        xr.testing.assert_identical(a.drop_attrs(), b.drop_attrs())


@compiled
def test_truth_file_contains_every_quantity_with_a_name(petrel, rough, tmp_path):
    summary = simulate_mission(petrel, tmp_path / "rough.nc", scenario=rough.replaced({"profiles": 2}), seed=9)
    _, truth = simulate_profile(petrel, rough, 9, number=2)
    stored = read_profile_truth(summary.truth_path, 2)
    np.testing.assert_allclose(stored.gust, truth.water[:, 2], rtol=1e-6)
    np.testing.assert_allclose(stored.water_east, truth.water[:, 1], rtol=1e-6)
    np.testing.assert_allclose(stored.profile_current_north, truth.shear[:, 0])
    np.testing.assert_array_equal(stored.level, truth.levels)
    np.testing.assert_allclose(stored.true_K_D0, truth.coefficients["K_D0"])
    assert float(stored.surface_current_east_after) == truth.surface_currents[1][1]
    assert float(stored.course) == pytest.approx(np.degrees(truth.course) % 360.0)
    for name, variable in stored.variables.items():
        assert "long_name" in variable.attrs, name


@compiled
def test_interrupted_mission_leaves_nothing(petrel, rough, tmp_path):
    def stop(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate_mission(petrel, tmp_path / "m.nc", scenario=rough, on_profile=stop)
    assert not any(tmp_path.iterdir())


# Command line


@compiled
def test_command_takes_scenarios_and_overrides(tmp_path):
    out = tmp_path / "m.nc"
    answer = program(
        "simulate-mission", out, "--platform", "petrel-l", "--scenario", "harsh", "--profiles", 1, "--depth", 60,
    )  # fmt: skip
    assert answer.status == 0, answer.err
    assert "1 profile, 0 d" in answer.out
    with open_observations(out) as observations:
        assert "harsh" in observations.mission
        assert 15.0 < observations.profile(1).depth[np.isfinite(observations.profile(1).depth)].max() < 120.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--scenario", "papr"), "unknown scenario 'papr', did you mean 'paper'"),
        (("--depth", "-3"), "depth is -3"),
    ],
)
def test_command_refuses_in_one_line(tmp_path, arguments, message):
    answer = program("simulate-mission", tmp_path / "m.nc", "--platform", "petrel-l", *arguments)
    assert answer.status == 2
    assert message in answer.line
