"""Impossible values are rejected: fixes, times, clocks, units and extents of an observation file."""

import time as clock
from dataclasses import replace

import numpy as np
import pytest
from support.missions import program
from support.observation_files import ATTRIBUTES, SAMPLES, START, edited, first_sample, mission, write
from support.seaglider_files import pitches, write_dive

from gliderhpc.errors import InputError
from gliderhpc.mission import planning
from gliderhpc.mission.planning import plan_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations, write_observations
from gliderhpc.observations.checks.profile_checks import check_pace
from gliderhpc.observations.checks.sign_checks import check_signs
from gliderhpc.observations.fixes import rounding_error, screen_fixes
from gliderhpc.observations.intervals import local_intervals
from gliderhpc.observations.times import decode_times
from gliderhpc.wording import most_frequent_reason

POSITIONS = ("fix_latitude", "fix_longitude")

PER_SURFACING = 2
"""Fixes of each surface interval of `mission`, but for the last."""


def notes(path):
    """Notes on every profile, and whether it has fixes on both sides."""
    with open_observations(path) as observations:
        records = [observations.profile(number) for number in observations.profile_numbers]
        return [(" ".join(r.notes), r.entry_fix is not None and r.exit_fix is not None) for r in records]


def changed_fixes(**changes):
    """Fixes of the mission, some changed: ``latitude={2: 77.0}``."""
    made = mission()
    for name, values in changes.items():
        for index, value in values.items():
            made[f"fix_{name}"][index] = value
    return {name: made[name] for name in ("fix_latitude", "fix_longitude")}


# Fixes


@pytest.mark.parametrize(
    ("index", "profiles"), [(0, [1]), (2, [1, 2]), (3, [1, 2]), (6, [3])], ids=["first", "between", "entry", "last"]
)
def test_a_fix_far_off_is_left_out_and_reported(tmp_path, index, profiles):
    """The neighbours on both sides show which fix of a pair is wrong."""
    off = mission()["fix_latitude"][index] + 27.0
    for number, (text, _) in enumerate(notes(write(tmp_path, **changed_fixes(latitude={index: off}))), start=1):
        assert ("m/s over ground (glider and current together reach at most 4 m/s)" in text) == (number in profiles)
    with open_observations(tmp_path / "mission.nc") as observations:
        assert len(observations.survey.fixes.time) == len(mission()["fix_time"]) - 1
        assert "left out" in observations.warnings[0]


def test_a_whole_surfacing_far_off_leaves_both_dives_without_current(tmp_path):
    wrong = changed_fixes(latitude={2: 77.0, 3: 77.0})
    found = notes(write(tmp_path, **wrong))
    assert [there for _, there in found] == [False, False, True]
    assert "no GPS fix after the profile" in found[0][0]
    assert "no GPS fix before the profile" in found[1][0]


def test_two_surfacings_that_contradict_each_other_are_both_left_out():
    """It is not known which of the two is wrong."""
    time = START + np.array([0, 60, 4000, 4060]) * np.timedelta64(1, "s")
    found = screen_fixes(time, np.array([50.0, 50.0, 77.0, 77.0]), np.full(4, -128.0), np.ones(4, dtype=bool))
    assert len(found.time) == 0
    assert len(found.reasons) == 4


def test_a_record_of_two_places_keeps_its_fixes_but_no_pair_across(tmp_path):
    """A glider carried from one place to another within a file: the fixes at each place confirm each other."""
    made = mission(4)
    made["fix_latitude"][4:] += 0.2
    path = write_observations(made, tmp_path / "two.nc", attributes=ATTRIBUTES)
    found = notes(path)
    assert [there for _, there in found] == [True, False, True, True]
    assert "between the fixes before and after the profile: neither is used" in found[1][0]


@pytest.mark.parametrize(("profiles", "wrong", "used"), [(4, slice(4, None), 0), (9, slice(4, 8), 6)])
def test_positions_that_nothing_can_have_reached_are_left_out_unless_they_are_many(profiles, wrong, used, tmp_path):
    """The sign of the latitude of several surfacings is lost: of equal parts none is used, of few they are not."""
    made = mission(profiles)
    made["fix_latitude"][wrong] *= -1.0
    found = notes(write_observations(made, tmp_path / "south.nc", attributes=ATTRIBUTES))
    assert sum(there for _, there in found) == used
    assert all("m/s over ground" in text for text, there in found if not there)
    with open_observations(tmp_path / "south.nc") as observations:
        assert np.all(observations.survey.fixes.latitude > 0.0)


def test_fixes_at_null_are_missing(tmp_path):
    zero = dict.fromkeys(range(7), 0.0)
    path = write(tmp_path, **changed_fixes(latitude=zero, longitude=zero))
    found = notes(path)
    assert not any(there for _, there in found)
    assert all("0 N, 0 E, which a receiver reports if it has no position" in text for text, _ in found)
    with open_observations(path) as observations:
        assert "no usable GPS fix in the file (GPS fix of" in observations.warnings[0]


def test_minutes_within_a_degree_of_null_are_recognised(tmp_path):
    """DDMM.mmm below one degree is a plausible position in degrees, sixty times as far from the next."""
    along = 0.0010137 * np.arange(7)
    minutes = {"fix_latitude": 60.0 * (0.35 + along), "fix_longitude": 60.0 * (0.62 + along)}
    path = write(tmp_path, **minutes)
    with open_observations(path) as observations:
        assert "agree with each other if they are DDMM.mmm" in observations.warnings[0]


def test_a_position_that_never_changes_is_stale(tmp_path):
    """The first surfacing may be right; nothing stays in place to the last digit for longer than half an hour."""
    made = mission(4)
    same = {"fix_latitude": np.full(9, 50.0), "fix_longitude": np.full(9, -128.0)}
    found = notes(write_observations(made | same, tmp_path / "still.nc", attributes=ATTRIBUTES))
    assert not any(there for _, there in found)
    assert "it repeats the position of" in found[-1][0]


def test_a_position_that_is_the_same_after_a_dive_gives_no_current(tmp_path):
    """Even in a file shorter than the half hour after which a position is stale."""
    same = changed_fixes(latitude={1: 50.0, 2: 50.0}, longitude={1: -128.0, 2: -128.0})
    text, there = notes(write(tmp_path, **same))[0]
    assert not there
    assert "to the last digit, although a profile lies between them: neither is used" in text


def test_plausible_fixes_are_left_alone():
    rng = np.random.default_rng(1)
    seconds = np.cumsum(rng.uniform(20.0, 4000.0, 500))
    time = START + (seconds * 1e9).astype("timedelta64[ns]")
    latitude = 50.0 + np.cumsum(rng.uniform(-1.0, 1.0, 500) * np.diff(seconds, prepend=0.0)) / 111_195.0
    longitude = 179.9999 + 1e-6 * np.arange(500)
    found = screen_fixes(time, latitude, np.where(longitude > 180.0, longitude - 360.0, longitude), np.ones(500, bool))
    assert found.reasons == ()
    np.testing.assert_array_equal(found.time, time)


def test_a_fix_under_water_says_that_the_clocks_disagree(tmp_path):
    """A fix comes from the surface: with the glider at 40 m the samples' clock is not that of the fixes."""
    late = mission()["fix_time"] + np.timedelta64(500, "s")
    found = notes(write(tmp_path, fix_time=late))
    assert not any(there for _, there in found)
    assert all("the clocks of fixes and samples disagree" in text for text, _ in found)


def test_the_survey_of_some_profiles_gives_the_same_records(tmp_path):
    path = write(tmp_path, **changed_fixes(latitude={2: 77.0}))
    with open_observations(path) as whole:
        cut = whole.survey.only([2])
        with open_observations(path, survey=cut) as part:
            ours, theirs = part.profile(2), whole.profile(2)
            assert part.profile_digest(2) == whole.profile_digest(2)
    assert ours.notes == theirs.notes
    assert [fix.time for fix in ours.surface_fixes_before] == [fix.time for fix in theirs.surface_fixes_before]
    assert len(cut.fixes.time) < len(whole.survey.fixes.time)


# Times


def test_a_clock_set_back_within_a_profile_costs_the_next_one_its_fixes(tmp_path):
    time = mission()["time"].copy()
    time[first_sample(2) + 200 :] -= np.timedelta64(200, "s")
    with open_observations(write(tmp_path, time=time)) as observations:
        assert list(observations.faults) == [2]
        assert observations.profile(3).entry_fix is None
        assert "the clock was set back by 199 s in profile 2, the preceding one" in observations.profile(3).notes[0]
        assert observations.profile(1).entry_fix is not None


def with_raw_time(path, sample, value):
    def edit(dataset):
        time = dataset["time"].values.copy()
        time[sample] = value
        return dataset.assign(time=("time", time, dataset["time"].attrs))

    return edited(path, edit)


@pytest.mark.parametrize("value", [np.inf, 1e300, -1e18, 9.96921e36, 86_400.0 * 365.25 * 8000], ids=str)
def test_times_that_no_clock_gives_are_named(tmp_path, value):
    sample = first_sample(2) + 7
    with open_observations(with_raw_time(tmp_path, sample, value)) as observations:
        assert observations.faults == {}
        assert observations.warnings == (
            f"time is not between 2000 and 2099 in 1 sample, the first at sample {sample}: left out; correct the "
            "clock, or declare the fill value (_FillValue)",
        )
        assert np.isnan(observations.profile(2).depth).sum() == 1
        assert observations.profile(1).time[-1] == pytest.approx(SAMPLES - 1)


@pytest.mark.parametrize(("units", "step"), [("seconds since 1970-01-01", 128), ("days since 1950-01-01", 169)])
def test_times_of_too_coarse_a_type_are_refused(tmp_path, units, step):
    def edit(dataset, kind):
        unit, reference = units.split(" since ")
        seconds = (mission()["time"] - np.datetime64(reference, "ns")) / np.timedelta64(1, "s")
        values = (seconds / {"seconds": 1.0, "days": 86_400.0}[unit]).astype(kind)
        return dataset.assign(time=("time", values, {"units": units, "standard_name": "time"}))

    with pytest.raises(InputError, match=rf"time is stored as float32, which resolves '{units}' to {step} s only"):
        open_observations(edited(tmp_path, lambda dataset: edit(dataset, np.float32)))
    with open_observations(edited(tmp_path, lambda dataset: edit(dataset, np.float64))) as observations:
        assert observations.faults == {}


def test_seconds_since_the_start_may_be_single_precision(tmp_path):
    def edit(dataset):
        seconds = ((mission()["time"] - START) / np.timedelta64(1, "s")).astype(np.float32)
        seconds[-1] = np.float32(9.96921e36)
        units = f"seconds since {str(START.astype('datetime64[s]')).replace('T', ' ')}"
        return dataset.assign(time=("time", seconds, {"units": units, "_FillValue": np.float32(9.96921e36)}))

    with open_observations(edited(tmp_path, edit)) as observations:
        assert observations.faults == {}
        assert len(observations.profile(3).time) == SAMPLES - 1, "only the sample without its time"


def test_a_zone_by_name_is_refused(tmp_path):
    def edit(dataset, zone):
        dataset["time"].attrs["units"] += zone

    with pytest.raises(InputError, match=r"time is in .*'EST' is not a readable time zone; convert the times to UTC"):
        open_observations(edited(tmp_path, lambda dataset: edit(dataset, " EST")))
    for zone in ("", "Z", " UTC", " +00:00"):
        with open_observations(edited(tmp_path, lambda dataset, zone=zone: edit(dataset, zone))) as observations:
            assert observations.start_time(1) == START


@pytest.mark.parametrize(
    ("units", "words"),
    [
        ("seconds since yesterday", "has no valid reference date"),
        ("seconds since 1970-13-01", "has no valid reference date"),
        ("furlongs since 1970-01-01", "no CF time unit"),
        ("seconds", "no CF time unit"),
        ("seconds since 1970-01-01 00:00 Europe/Berlin", "is not a readable time zone"),
    ],
)
def test_invalid_units_of_time_are_refused(units, words):
    with pytest.raises(InputError, match=words):
        decode_times(np.array([1.6e9]), units, "", "m.nc: time")


def test_offsets_are_taken_off():
    for zone, hours in (("+01:00", -1), ("-0500", 5), ("-6:00", 6), ("Z", 0)):
        found = decode_times(np.array([86_400.0]), f"seconds since 2024-05-01 12:00:00 {zone}", "", "time").time[0]
        assert found == np.datetime64("2024-05-02T12:00:00") + np.timedelta64(hours, "h")


def test_days_for_seconds_are_refused_before_anything_is_made(tmp_path):
    def edit(dataset):
        dataset["time"].attrs["units"] = dataset["time"].attrs["units"].replace("seconds", "days")

    with pytest.raises(InputError, match=r"time is not between 2000 and 2099 at sample 0; correct .* the unit of time"):
        open_observations(edited(tmp_path, edit))


def test_a_profile_that_lasts_weeks_is_a_fault(tmp_path):
    slow = START + 6000 * (mission()["time"] - START)
    with open_observations(write(tmp_path, time=slow)) as observations:
        assert list(observations.faults) == [1, 2, 3]
        assert "lasts 27.7 days, but at most 20 days are plausible; check the unit of time" in observations.faults[1]


@pytest.mark.parametrize(("factor", "words"), [(60, "slower than any glide"), (0.5, "faster than any glider")])
def test_a_pace_of_no_glider_is_named(tmp_path, factor, words):
    # Minutes for seconds: every profile then lasts hours, which alone is plausible.
    made = mission()
    time = START + (factor * (made["time"] - START).astype("timedelta64[us]").astype(float)).astype("timedelta64[us]")
    depth = made["depth"] * (1 if factor > 1 else 30)
    with open_observations(write(tmp_path, time=time, depth=depth)) as observations:
        assert list(observations.faults) == [1, 2, 3]
        assert words in observations.faults[1]
        assert "check the units of time and depth" in observations.faults[2]


@pytest.mark.parametrize(
    ("depth", "seconds"),
    [
        ([0.0, 20.0, 0.0, 0.0], [0.0, 200.0, 400.0, 90_000.0]),
        ([0.0, 1000.0, 1000.0, 0.0], [0.0, 20_000.0, 1_000_000.0, 1_020_000.0]),
        ([0.0, 3.0, 0.0], [0.0, 5_000.0, 10_000.0]),
        ([0.0, 1000.0, 0.0], [0.0, 33_000.0, 66_000.0]),
    ],
    ids=["a short dive and a day at the surface", "a drift at depth", "hardly a dive", "the slowest glide"],
)
def test_a_slow_profile_with_a_glide_in_it_stands(depth, seconds):
    at = np.linspace(seconds[0], seconds[-1], 20_001)
    time = START.astype("datetime64[ns]") + (1e9 * at).astype("timedelta64[ns]")
    assert check_pace(time, np.interp(at, seconds, depth), {1: (0, len(at))}, {}) == {}


def test_a_gap_of_ten_years_fails_its_profile_and_sizes_nothing(tmp_path):
    time = mission()["time"].copy()
    time[first_sample(2) + 100 :] += np.timedelta64(3652, "D")
    with open_observations(write(tmp_path, time=time)) as observations:
        assert list(observations.faults) == [2]
        assert "a gap of 3.65e+03 days from 2024-05-01T12:18:19 on" in observations.faults[2]
        plan = plan_mission(observations, MissionSettings(), (1, 2, 3))
    assert plan.sizes["sample"] == round((SAMPLES - 1) / MissionSettings().step) + 1


# Units of values


@pytest.mark.parametrize(("factor", "unit"), [(1e-6, "m3"), (1e-3, "litres")])
def test_ballast_in_another_unit_is_named(tmp_path, factor, unit):
    with open_observations(write(tmp_path, ballast_volume=mission()["ballast_volume"] * factor)) as observations:
        assert list(observations.faults) == [1, 2, 3]
        assert "too little oil to drive a glider; if it is in m3 or litres, convert it to cm3" in observations.faults[1]


def test_pitch_in_radians_is_named(tmp_path):
    with open_observations(write(tmp_path, pitch=np.radians(mission()["pitch"]))) as observations:
        assert list(observations.faults) == [1, 2, 3]
        assert "too flat for a glide; if it is in radians, convert it to degrees" in observations.faults[2]


def test_heading_in_radians_is_refused(tmp_path):
    round_about = np.linspace(0.0, 2.0 * np.pi, 3 * (SAMPLES + 10))
    with pytest.raises(InputError, match=r"heading lies between 0\.\d+ and 6\.\d+ degree .* it is in radians"):
        open_observations(write(tmp_path, heading=round_about))
    with open_observations(write(tmp_path, heading=np.full(3 * (SAMPLES + 10), 3.0))) as observations:
        assert observations.faults == {}


@pytest.mark.parametrize("number", [9.96e36, -2147483647.0, 1.5])
def test_fill_values_for_profile_numbers_are_refused(tmp_path, number):
    def edit(dataset):
        numbers = dataset["profile"].values.astype(float)
        numbers[numbers == 0] = number
        return dataset.assign(profile=("time", numbers, {"units": "1", "_FillValue": np.nan}))

    with pytest.raises(InputError, match=r"whole number up to 1000000, 0 outside any profile; a fill value must be"):
        open_observations(edited(tmp_path, edit))


# Memory


def test_more_memory_than_the_machine_has_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(planning, "memory_limit", lambda: 3.5e8)
    with open_observations(write(tmp_path)) as observations:
        plan = plan_mission(observations, MissionSettings(), (1, 2, 3))
        assert plan.workers_that_fit(MissionSettings(), 8) == 1
        plan.check_memory(MissionSettings(), 1)
        with pytest.raises(InputError, match=r"2 workers would need 0.7 GB of memory, but 0.3 GB .* give `workers=1`"):
            plan.check_memory(MissionSettings(), 2)
        with pytest.raises(InputError, match="leave the longest profiles out with `profiles`"):
            replace(plan, longest=10_000_000).check_memory(MissionSettings(), 1)
        monkeypatch.setattr(planning, "memory_limit", lambda: 3.2e8)
        with pytest.raises(InputError, match=r"profile 1 lasts 0.1 h with 400 samples and needs 0.3 GB of memory"):
            plan_mission(observations, MissionSettings(), (1, 2, 3))


def test_the_machine_has_some_memory():
    assert 1e8 < planning.memory_limit() < 1e15


def test_local_intervals_do_not_depend_on_the_block(monkeypatch):
    intervals = np.random.default_rng(3).uniform(0.5, 20.0, 1000)
    whole = local_intervals(intervals)
    monkeypatch.setitem(local_intervals.__globals__, "_BLOCK", 37)
    np.testing.assert_array_equal(local_intervals(intervals), whole)


# Scale


def many(path, profiles, samples=40):
    """Many short profiles, five minutes at the surface between, a fix each time."""
    count, period = profiles * samples, 10.0 * samples + 300.0
    number, place = np.repeat(np.arange(profiles), samples), np.tile(np.arange(samples), profiles)
    fixes = period * np.arange(profiles + 1) - 20.0
    down = place < samples / 2

    def instants(seconds):
        return START + (seconds * 1e9).astype("timedelta64[ns]")

    variables = {
        "time": instants(number * period + 10.0 * place), "profile": number + 1,
        "depth": 50.0 * np.sin(np.pi * (place + 0.5) / samples), "roll": np.full(count, 2.0),
        "pitch": np.where(down, -20.0, 20.0), "heading": np.full(count, 75.0),
        "battery_position": np.full(count, 0.01), "battery_rotation": np.zeros(count),
        "ballast_volume": np.where(down, -250.0, 250.0), "fix_time": instants(fixes),
        "fix_latitude": 20.0 + 5e-4 * np.arange(len(fixes)), "fix_longitude": 115.0 + 3e-4 * np.arange(len(fixes)),
    }  # fmt: skip
    return write_observations(variables, path, attributes=ATTRIBUTES)


@pytest.mark.long
def test_the_time_to_plan_grows_with_the_profiles_and_not_with_their_square(tmp_path):
    """Five thousand had taken 47 s."""

    def planned(count, repeats):
        path, spent = many(tmp_path / f"{count}.nc", count), []
        for _ in range(repeats):
            began = clock.process_time()
            with open_observations(path) as observations:
                plan = plan_mission(observations, MissionSettings(), tuple(observations.profile_numbers))
            spent.append(clock.process_time() - began)
            assert len(plan.profiles) == count
            assert observations.warnings == ()
        return min(spent)

    assert planned(5000, 2) < 30.0 * planned(500, 5)


# Through the program


def test_the_most_frequent_reason_is_given_if_no_profile_is_usable(tmp_path):
    """The first profile is too short; the pitch is in radians."""
    whole = mission()
    numbers = whole["profile"].copy()
    numbers[np.flatnonzero(numbers == 1)[20:]] = 0
    path = write(tmp_path, profile=numbers, pitch=np.radians(whole["pitch"]))
    answer = program("run-mission", path, "--platform", "petrel-l", "--workers", 0, "--store", tmp_path / "m.zarr")
    assert answer.status == 2
    assert "no usable profile; 2 of 3: profile 2: pitch lies between" in answer.line
    answer = program("inspect", path, "--platform", "petrel-l")
    assert "no profile can be inspected; 2 of 3: profile 2: pitch lies between" in answer.line


@pytest.mark.parametrize(
    ("reasons", "given"),
    [
        (["profile 3: too short"], "profile 3: too short"),
        (["a", "b", "b"], "2 of 3: b"),
        (["lasts 3 s", "pitch is +18.2", "pitch is -2e-05"], "2 of 3: pitch is +18.2"),
    ],
)
def test_reasons_that_differ_in_numbers_are_the_same(reasons, given):
    assert most_frequent_reason(reasons) == given


@pytest.mark.parametrize("dry", [(), ("--dry-run",)], ids=["run", "dry"])
def test_a_dry_run_refuses_what_the_run_refuses(tmp_path, dry):
    path = write(tmp_path, pitch=np.radians(mission()["pitch"]))
    store = tmp_path / "m.zarr"
    answer = program("run-mission", path, "--platform", "petrel-l", "--workers", 0, "--store", store, *dry)
    assert answer.status == 2
    assert "no usable profile; 3 of 3: profile 1: pitch lies between" in answer.err.splitlines()[-1]
    store.mkdir()
    (store / "notes.txt").write_text("mine")
    good = write(tmp_path)
    answer = program("run-mission", good, "--platform", "petrel-l", "--workers", 0, "--store", store, *dry)
    assert answer.status == 2
    assert "is not an archive of gliderhpc, so it is not replaced" in answer.err.splitlines()[-1]
    answer = program(
        "run-mission", good, "--platform", "petrel-l", "--store", tmp_path / "n.zarr", "--set", "seawater=density", *dry
    )
    assert answer.status == 2
    assert "states no buoyancy.compressibility" in answer.err.splitlines()[-1]


def test_a_dry_run_names_the_profiles_that_will_fail(tmp_path):
    time = mission()["time"].copy()
    time[first_sample(2) + 100 :] += np.timedelta64(3652, "D")
    path = write(tmp_path, time=time)
    answer = program("run-mission", path, "--platform", "petrel-l", "--store", tmp_path / "m.zarr", "--dry-run")
    assert answer.status == 0
    plan, failing = answer.out.splitlines()
    assert plan.startswith("3 profiles")
    assert failing.startswith("will fail: profile 2: a gap of 3.65e+03 days")


@pytest.mark.parametrize(
    "words",
    [
        ("import", "seaexplorer", "m", "o.nc", "--linear-scale", "nan"),
        ("import", "seaexplorer", "m", "o.nc", "--linear-zero", "inf"),
        ("import", "slocum", "m", "o.nc", "--battery-scale", "1e300"),
        ("import", "og1", "m", "o.nc", "--declination", "nan"),
        ("platforms", "petrel-l", "--net-mass", "nan"),
        ("platforms", "petrel-l", "--pitch", "nan"),
        ("simulate-mission", "o.nc", "--platform", "petrel-l", "--depth", "inf"),
        ("simulate-mission", "o.nc", "--platform", "petrel-l", "--seed", "9" * 30),
        ("run-mission", "m.nc", "--platform", "petrel-l", "--store", "s", "--workers", "9" * 30),
        ("run-mission", "m.nc", "--platform", "petrel-l", "--store", "s", "--worker-timeout", "nan"),
        ("twin", "windows", "--out", "t", "--seeds", "9" * 30),
    ],
    ids=" ".join,
)
def test_numbers_out_of_range_on_the_command_line_are_refused(words):
    answer = program(*words)
    assert answer.status == 2
    assert "Invalid value for" in answer.err
    assert "Traceback" not in answer.err


# Signs


def glide(pitch=-25.0, ballast=-250.0, every=1, climb=True):
    """Dive and climb of 900 s each, the climb with the opposite pitch and ballast; time, depth, pitch, ballast."""
    seconds = np.arange(0, 1800 if climb else 900, every)
    down = seconds < 900
    depth = np.minimum(0.15 * seconds, 0.15 * (1800.0 - seconds)) + 1.0
    time = START + seconds.astype("timedelta64[s]")
    return time, depth, np.where(down, pitch, -pitch), np.where(down, ballast, -ballast)


def fault_of_signs(time, depth, pitch, ballast, roll=None, rotation=None, faults=()):
    upright = np.zeros(len(time))
    glide = {
        "depth": depth, "pitch": pitch, "ballast_volume": ballast, "roll": upright if roll is None else roll,
        "battery_rotation": upright if rotation is None else rotation,
    }  # fmt: skip
    return check_signs(time, glide, {4: (0, len(time))}, dict(faults)).get(4)


@pytest.mark.parametrize(("scale", "said"), [(0.1, "too slowly"), (9.81, "faster than any glider")])
def test_a_depth_in_another_unit_is_named(scale, said):
    """Bar and kilopascal, declared as metres."""
    time, depth, *others = glide()
    assert said in fault_of_signs(time, scale * depth, *others)


def test_a_glider_that_is_stuck_on_the_bottom_has_its_depth_in_metres():
    time, depth, pitch, ballast = glide()
    bottom = len(time) // 2
    hours = time[bottom] + np.arange(10 * 3600).astype("timedelta64[s]")
    longer = np.concatenate([time[:bottom], hours, time[bottom:] + np.timedelta64(10, "h")])
    columns = [
        np.concatenate([one[:bottom], np.full(len(hours), one[bottom - 1]), one[bottom:]])
        for one in (depth, pitch, ballast)
    ]
    assert fault_of_signs(longer, *columns) is None


@pytest.mark.parametrize("every", [1, 20, 100])
def test_a_reversed_sign_is_named_with_its_values(every):
    assert fault_of_signs(*glide(every=every)) is None
    assert fault_of_signs(*glide(pitch=25.0, every=every)) == (
        "profile 4: pitch is +25 degree while the glider sinks and -25 degree while it rises; nose up is positive, so "
        "reverse its sign"
    )
    assert fault_of_signs(*glide(ballast=250.0, every=every)) == (
        "profile 4: ballast_volume is +250 cm3 while the glider sinks and -250 cm3 while it rises; more oil outside "
        "the hull makes it rise, so reverse its sign"
    )


@pytest.mark.parametrize(
    "records",
    [
        glide(pitch=4.0),
        glide(ballast=9.0),
        glide(pitch=25.0, climb=False),
        glide(pitch=25.0, ballast=250.0, every=400),
    ],
    ids=["a flat profile", "hardly any oil moved", "a dive alone", "too few samples"],
)
def test_a_sign_that_is_not_certain_is_no_fault(records):
    assert fault_of_signs(*records) is None


@pytest.mark.parametrize(("leg", "interval"), [(50.0, 1.0), (33.0, 1.0), (240.0, 300.0), (240.0, 500.0)])
def test_cycles_that_are_not_resolved_are_not_judged(leg, interval):
    """Averages and differences of such cycles can have the opposite direction of the glider's."""
    seconds = np.arange(0.0, 200.0 * leg, interval)
    place = np.mod(seconds, 2.0 * leg)
    down = place < leg
    depth = 1.0 + 0.35 * np.where(down, place, 2.0 * leg - place)
    time = START + (1e9 * seconds).astype("timedelta64[ns]")
    pitch, ballast = np.where(down, -25.0, 25.0), np.where(down, -250.0, 250.0)
    assert fault_of_signs(time, depth, pitch, ballast) is None


def test_an_importer_reports_a_reversed_pitch(tmp_path):
    path = write_dive(tmp_path / "sg", 1, columns=True, eng_pitchAng=-pitches())
    answer = program("import", "seaglider", path, tmp_path / "out.nc")
    assert "reverse its sign" in answer.out + answer.err


def test_missing_samples_and_other_faults_do_not_disturb_the_signs():
    time, depth, pitch, ballast = glide(pitch=25.0)
    holes = np.arange(len(time)) % 7 > 0
    depth, pitch = np.where(holes, depth, np.nan), np.where(~holes, pitch, np.nan)
    assert "reverse its sign" in fault_of_signs(time, depth, pitch, ballast)
    assert fault_of_signs(time, depth, pitch, ballast, faults={4: "too short"}) is None


@pytest.mark.parametrize("name", ["pitch", "roll", "battery_rotation"])
def test_a_profile_of_a_reversed_sign_is_left_out_of_its_file(tmp_path, name):
    time, depth, pitch, ballast = glide()
    rotation = turns()
    second = time + (time[-1] - time[0]) + np.timedelta64(1, "h")
    once = {
        "depth": depth, "pitch": pitch, "ballast_volume": ballast, "roll": 0.2 * rotation, "battery_rotation": rotation
    }  # fmt: skip
    both = {key: np.concatenate([values, -values if key == name else values]) for key, values in once.items()}
    rest = {"heading": 40.0, "battery_position": 0.01}
    constant = {name: np.full(2 * len(time), value) for name, value in rest.items()}
    number = np.repeat([1, 2], len(time))
    path = write_observations(
        {"time": np.concatenate([time, second]), "profile": number, **both, **constant},
        tmp_path / "two.nc",
        attributes=ATTRIBUTES,
    )
    with open_observations(path) as observations:
        assert list(observations.faults) == [2]
        assert "so reverse " in observations.faults[2]
        assert name in observations.faults[2]


# Roll and battery rotation


def turns(angle=20.0, where=slice(None)):
    """Rotation in the samples of `glide`: held for 90 s to starboard, 90 s to port and 180 s upright, in turn."""
    place = np.arange(1800) % 360
    rotation = np.zeros(1800)
    held = np.where(place < 90, angle, np.where(place < 180, -angle, 0.0))
    rotation[where] = held[where]
    return rotation


def waves(height):
    """Roll of short and of long period."""
    return height * np.sin(np.arange(1800.0) * 0.9) + height * np.sin(np.arange(1800.0) / 17.0)


@pytest.mark.parametrize("where", [slice(0, 900), slice(900, None)], ids=["sinking", "rising"])
def test_roll_against_the_rotation_in_one_phase_alone_is_no_fault(where):
    rotation = turns(where=where)
    assert fault_of_signs(*glide(), -0.175 * rotation + waves(1.0), rotation) is None


def test_roll_against_the_rotation_is_named_with_its_values():
    rotation = turns()
    roll = 0.175 * rotation + waves(1.0)
    assert fault_of_signs(*glide(), roll, rotation) is None
    assert fault_of_signs(*glide(), -roll, -rotation) is None
    assert "reverse the sign of roll or of battery_rotation" in fault_of_signs(*glide(), -roll, rotation)
    assert "reverse the sign of roll or of battery_rotation" in fault_of_signs(*glide(), roll, -rotation)


def test_a_reversed_roll_is_named_with_the_rotations():
    rotation = turns()
    assert fault_of_signs(*glide(), -0.25 * rotation, rotation) == (
        "profile 4: roll is +5.0 degree where battery_rotation is -20 degree and -5.0 degree where it is +20 degree; "
        "both are positive with starboard down, so reverse the sign of roll or of battery_rotation"
    )


def test_roll_in_radians_is_named():
    rotation = turns()
    assert fault_of_signs(*glide(), np.radians(0.2 * rotation + 3.0), rotation) == (
        "profile 4: roll is -0.017 degree where battery_rotation is -20 degree and +0.122 degree where it is +20 "
        "degree, too little; if roll is in radians, convert it to degrees"
    )


@pytest.mark.parametrize("roll", [3.0, -20.0 + waves(3.0), waves(0.1)], ids=["still", "a heavy trim", "flat"])
@pytest.mark.parametrize("rotation", [0.0, 40.0, turns(4.0)], ids=["rudder", "a rotation that stays", "little"])
def test_roll_without_rotation_is_no_fault(roll, rotation):
    whole = np.zeros(1800)
    assert fault_of_signs(*glide(), roll + whole, rotation + whole) is None


@pytest.mark.parametrize("height", [1.0, 10.0])
def test_roll_of_waves_is_no_fault(height):
    assert fault_of_signs(*glide(), waves(height), turns()) is None


def test_a_trim_that_differs_between_dive_and_climb_and_is_balanced_is_no_fault():
    """Roll and rotation differ between sinking and rising with opposite signs; within each, roll follows."""
    down = np.arange(1800) < 900
    rotation = turns() + np.where(down, 30.0, -30.0)
    roll = 0.2 * turns() + np.where(down, -10.0, 10.0)
    assert np.corrcoef(roll, rotation)[0, 1] < -0.7
    assert fault_of_signs(*glide(), roll, rotation) is None


def test_a_controller_of_roll_is_no_reversed_sign():
    """The battery compensates a varying heel; the remaining heel is opposite to the rotation."""
    heel = 4.0 * np.sin(np.arange(1800.0) / 60.0)
    roll = heel / (1.0 + 0.4 * 4.0)
    rotation = -4.0 * roll
    assert np.ptp(rotation) > 12.0
    assert fault_of_signs(*glide(), roll, rotation) is None


def test_a_reversed_rotation_that_moves_all_the_time_must_show_sinking_and_rising():
    swing = 30.0 * np.sin(np.arange(1800.0) / 60.0)
    assert "reverse" in fault_of_signs(*glide(), -0.4 * swing, swing)
    dive = np.where(np.arange(1800) < 900, swing, 0.0)
    assert fault_of_signs(*glide(), -0.4 * dive, dive) is None


# Positions on a grid, dives without a number, and a depth in feet


def test_rounded_positions_are_named_with_their_error(tmp_path):
    made = mission()
    coarse = {name: np.round(made[name], 3) for name in POSITIONS}
    with open_observations(write(tmp_path, **coarse)) as observations:
        (text,) = observations.warnings
    assert text == (
        "all GPS positions are rounded to 0.001 degree, so their error is 32 m or more; give the positions in full, or "
        "`current.fix_error=32`"
    )
    found, _ = rounding_error(*np.round(np.random.default_rng(3).uniform(10.0, 11.0, (2, 8)), 2))
    assert found == pytest.approx(0.01 * 111_195.0 / np.sqrt(12.0), rel=1e-6)


def test_positions_in_full_are_not_called_rounded():
    made = mission()
    assert rounding_error(*(np.round(made[name], 5) for name in POSITIONS)) == (0.0, "")
    assert rounding_error(np.array([50.0, 50.0]), np.array([-128.0, -128.0])) == (0.0, "")


def test_a_dive_without_a_number_is_named(tmp_path):
    def without(*numbers):
        def edit(records):
            known = records["profile"].astype(float)
            return records.assign(profile=known.where(~known.isin(numbers)).assign_attrs(records["profile"].attrs))

        path = edited(tmp_path, edit)
        with open_observations(path) as observations:
            return observations.warnings, observations.profile_numbers

    (text,), numbers = without(2)
    assert numbers == [1, 3]
    assert text.startswith("profile is missing (NaN) in ")
    assert "samples below 20 m, from 2024-05-01" in text
    # Samples at the surface belong to no profile anyhow.
    assert without(0) == ((), [1, 2, 3])


def test_a_depth_in_feet_fails_its_profile(tmp_path):
    """The record's own pressure reveals the unit; at this pace the depth alone does not."""
    made = mission()
    slow = {name: START + 8 * (made[name] - START) for name in ("time", "fix_time")}
    depth = np.where(made["profile"] == 2, made["depth"] / 0.3048, made["depth"])
    with open_observations(write(tmp_path, depth=depth, pressure=made["depth"] / 0.99, **slow)) as observations:
        assert list(observations.faults) == [2]
        assert "so it is in feet; convert it to metres" in observations.faults[2]


def test_a_temperature_or_salinity_that_never_changes_is_named(tmp_path):
    """With a salinity that is filled in, the heave force of a hull with buoyancy by density was off by 1 N."""
    made = mission()
    depth = 1.2 * made["depth"]
    sea = {"temperature": 18.0 - 0.01 * depth, "practical_salinity": np.full(len(depth), 35.0), "pressure": depth}
    found = notes(write(tmp_path, depth=depth, **sea))
    assert all(
        "practical_salinity is 35 in all its samples from 0 to 60 m: unless the water" in text for text, _ in found
    )
    assert not any("temperature is" in text for text, _ in found)
