"""Buoyancy by measured density: its equation, the water along a record, twins in a stratified ocean, bad CTDs."""

import math
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from support.missions import changed_observations, estimate, profile_series, program

from gliderhpc.archive.mission import open_mission
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.calibration.glides.fit import calibrate_on_glides
from gliderhpc.calibration.glides.segment_errors import choose_buoyancy
from gliderhpc.calibration.settings import CalibrationSettings
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import check_seawater, controls_of, describe_unexpected_density, prepare_profile
from gliderhpc.estimation.quality import SLOPE_BIAS, buoyancy_remarks
from gliderhpc.estimation.resample import on_steps, resample
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.steady_segments import SegmentSettings, join_segments, segments_of
from gliderhpc.flight.buoyancy import DENSITY, PRESSURE, REFERENCE_TEMPERATURE, TEMPERATURE, excess_weight
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import PARAMETERS_BY_DENSITY, TYPICAL_COMPRESSIBILITY
from gliderhpc.mission.run import MissionResult, _warn_about_depth_slope
from gliderhpc.observations import Fix, ProfileRecord, open_observations
from gliderhpc.observations.instruments.seaexplorer import import_seaexplorer
from gliderhpc.observations.seawater import with_seawater
from gliderhpc.platform import GRAVITY, platform_yaml, read_platform, with_overrides
from gliderhpc.simulator import load_scenario, read_scenario, simulate_mission
from gliderhpc.simulator.hull import FloatingHull
from gliderhpc.simulator.ocean import ocean_column
from gliderhpc.simulator.profile import simulate_profile
from gliderhpc.store_schema import check_archive
from gliderhpc.studies.archived import series_of
from gliderhpc.studies.validation import run_forward

PETREL = read_platform("petrel-l")
SOFT = with_overrides(
    PETREL,
    {
        "buoyancy.compressibility": "4.5e-6",
        "buoyancy.thermal_expansion": "6e-5",
        "buoyancy.depth_slope": "0.004",
    },
)
EPOCH = np.datetime64("2024-05-01T12:00:00", "ns")
STRATIFIED = load_scenario("stratified").replaced({"depth": 150.0, "profiles": 2})

# SA, CT and p of the check values of GSW (McDougall & Barker 2011, www.teos-10.org): practical salinity at 188 E, 4 N,
# in-situ temperature, pressure, and the density of the 75-term equation.
CHECK = [
    (34.548721553448317, 28.7856, 10.0, 1021.840173185531),
    (34.727477488096639, 28.4329, 50.0, 1022.262689926782),
    (34.860554877708005, 22.8103, 125.0, 1024.427715941676),
    (34.680971112271791, 10.2600, 250.0, 1027.790201811623),
    (34.567971663653388, 6.8863, 600.0, 1029.837714725961),
    (34.560036751118204, 4.4036, 1000.0, 1032.002404116447),
]


def cast(pressure, temperature, salinity, **changes):
    """Record of a dive (and climb) through given water, a sample a second; depth is a hundredth less than pressure."""
    n = len(pressure)
    zero = np.zeros(n)
    there = Fix(EPOCH, 4.0, 188.0)
    values = {
        "depth": 0.99 * pressure, "temperature": np.broadcast_to(temperature, n).copy(),
        "practical_salinity": np.broadcast_to(salinity, n).copy(), "pressure": pressure, "entry_fix": there,
    } | changes  # fmt: skip
    return ProfileRecord(
        7, EPOCH, np.arange(n, dtype=float), *[zero] * 3, values.pop("depth"), *[zero] * 4, **values
    )  # fmt: skip


def dive_and_climb(deepest=400.0, rate=0.4):
    down = np.arange(1.0, deepest, rate)
    return np.concatenate([down, down[::-1]])


def thermocline(pressure):
    return 6.0 + 12.0 / (1.0 + np.exp((pressure - 80.0) / 15.0))


def water_of(record):
    series = with_seawater(resample(record, 0.5, 10.0), record)
    assert series.seawater is not None, series.without_seawater
    return series.seawater


def reason_of(record):
    series = with_seawater(resample(record, 0.5, 10.0), record)
    assert series.seawater is None
    return series.without_seawater


# The equation


def test_weight_is_that_of_the_displaced_water():
    """Weight less displaced water, the hull squeezed and warmed (Merckelbach et al. 2010), written out."""
    volume = np.array([200e-6, 900e-6])
    water = np.array([[0.0, 1021.0, 25.0, 0.0], [500.0, 1030.2, 4.0, 506.0]])
    buoyancy = SOFT.buoyancy
    hull = SOFT.mass.total / buoyancy.water_density - buoyancy.neutral_volume_m3
    squeezed = hull * (1.0 - 4.5e-6 * water[:, PRESSURE] + 6e-5 * (water[:, TEMPERATURE] - REFERENCE_TEMPERATURE))
    expected = GRAVITY * (SOFT.mass.total - water[:, DENSITY] * (squeezed + volume))
    known = -GRAVITY * buoyancy.water_density * (volume - buoyancy.neutral_volume_m3)
    given_back = 0.004 * water[:, 0]
    np.testing.assert_allclose(excess_weight(SOFT, volume, water), expected - known + given_back, rtol=1e-9)


def test_nothing_is_added_in_the_platform_s_own_water():
    water = np.array([[0.0, SOFT.buoyancy.water_density, REFERENCE_TEMPERATURE, 0.0]])
    np.testing.assert_allclose(excess_weight(SOFT, [500e-6], water), 0.0, atol=1e-10)


def test_the_depth_slope_acts_off_the_recorded_depth_alone():
    """The part that ``rates`` subtracts at the recorded depth is added there; a metre deeper, k_z newtons are added."""
    state, water = np.zeros(12), np.array([[300.0, 1028.0, 8.0, 303.0]])
    state[5:7] = 300.0, 0.3
    rates = []
    for slope in ("0", "0.004"):
        hull = with_overrides(SOFT, {"buoyancy.depth_slope": slope})
        control = [0.0, 0.0, -0.05, 0.05, 0.0, *excess_weight(hull, [0.0], water)]
        rates.append([Glider(hull).rhs(state + np.eye(12)[5] * deeper, control, np.zeros(6)) for deeper in (0.0, 1.0)])
    np.testing.assert_allclose(rates[0][0], rates[1][0], atol=1e-15)
    gained = (rates[1][1] - rates[0][1])[8] * (SOFT.mass.total + SOFT.added_mass[2])
    assert gained == pytest.approx(-0.004, rel=1e-9)


# The water along a record


@pytest.mark.parametrize(("salinity", "temperature", "pressure", "density"), CHECK)
def test_density_is_that_of_the_teos_10_check_values(salinity, temperature, pressure, density):
    levels = np.clip(pressure + np.arange(-40.0, 40.0, 0.5), 0.5, None)
    water = water_of(cast(levels, temperature, salinity))
    at = np.argsort(water[:, PRESSURE])
    found = np.interp(pressure, water[at, PRESSURE], water[at, DENSITY])
    assert found == pytest.approx(density, abs=1e-3)
    assert np.interp(pressure, water[at, PRESSURE], water[at, TEMPERATURE]) == pytest.approx(temperature, abs=1e-4)


def test_spikes_leave_no_trace():
    pressure = dive_and_climb()
    clean = cast(pressure, thermocline(pressure), 35.0)
    rng = np.random.default_rng(3)
    spiked = np.where(rng.random(len(pressure)) < 0.03, 35.0 + rng.normal(0.0, 3.0, len(pressure)), 35.0)
    spiked[:3] = 20.0
    difference = water_of(replace(clean, practical_salinity=spiked)) - water_of(clean)
    assert np.abs(difference[:, DENSITY]).max() < 0.02


def test_seawater_missing_on_one_leg_is_taken_from_the_other():
    pressure = dive_and_climb()
    record = cast(pressure, thermocline(pressure), 35.0)
    silent = record.temperature.copy()
    silent[: len(pressure) // 2] = np.nan
    np.testing.assert_allclose(water_of(replace(record, temperature=silent)), water_of(record), atol=0.02)


def test_every_leg_has_its_own_water():
    pressure = dive_and_climb()
    warmer = np.where(np.arange(len(pressure)) < len(pressure) // 2, 0.0, 1.0)
    water = water_of(cast(pressure, thermocline(pressure) + warmer, 35.0))
    half = len(water) // 2
    for leg, offset in ((slice(20, half - 20), 0.0), (slice(half + 20, -20), 1.0)):
        expected = thermocline(water[leg, PRESSURE]) + offset
        np.testing.assert_allclose(water[leg, TEMPERATURE], expected, atol=0.15)


def test_pressure_comes_from_depth_and_latitude_where_there_is_none():
    """UNESCO (1983), eq. 25: depth from pressure and latitude in a standard ocean, here at 4 degrees."""
    pressure = dive_and_climb()
    record = cast(pressure, 10.0, 35.0, depth=0.99 * pressure)
    water = water_of(replace(record, pressure=None))
    p, sine = water[:, PRESSURE], math.sin(math.radians(4.0)) ** 2
    gravity = 9.780318 * (1.0 + (5.2788e-3 + 2.36e-5 * sine) * sine) + 1.092e-6 * p
    depth = (((-1.82e-15 * p + 2.279e-10) * p - 2.2512e-5) * p + 9.72659) * p / gravity
    np.testing.assert_allclose(water[:, 0], depth, atol=0.2)
    measured = water_of(record)
    np.testing.assert_allclose(measured[:, PRESSURE], measured[:, 0] / 0.99, atol=0.1)


def test_without_a_fix_reference_salinity_is_used():
    pressure = dive_and_climb()
    record = cast(pressure, thermocline(pressure), 35.0)
    np.testing.assert_allclose(water_of(replace(record, entry_fix=None)), water_of(record), atol=0.03)


def punctured(record, low, high):
    silent = np.where((record.pressure > low) & (record.pressure < high), np.nan, record.temperature)
    return replace(record, temperature=silent)


@pytest.mark.parametrize(
    ("change", "fragment"),
    [
        (lambda r: replace(r, temperature=None), "no temperature"),
        (lambda r: replace(r, practical_salinity=np.full_like(r.pressure, np.nan)), "no practical_salinity"),
        (
            lambda r: replace(r, practical_salinity=np.full_like(r.pressure, 99.0)),
            "salinity is 99, outside its plausible",
        ),
        (lambda r: replace(r, practical_salinity=np.zeros_like(r.pressure)), "salinity is 0 in all samples"),
        (lambda r: replace(r, practical_salinity=1e-3 * r.practical_salinity), "kg/kg; multiply it by 1000"),
        (lambda r: replace(r, temperature=r.temperature + 273.15), "degC; if it is in kelvin, convert it to degC"),
        (lambda r: replace(r, practical_salinity=spiked(1e-3 * r.practical_salinity, 35.0)), "in kg/kg"),
        (lambda r: alternating(r), "no sample with both temperature and practical_salinity in their plausible range"),
        (lambda r: replace(r, pressure=None, entry_fix=None), "neither pressure nor a GPS fix"),
        (lambda r: punctured(r, 40.0, 90.0), "no usable temperature and practical_salinity near 39 dbar"),
        (lambda r: punctured(r, 20.0, 1000.0), "no usable temperature and practical_salinity"),
    ],
)
def test_a_ctd_that_cannot_be_used_says_why(change, fragment):
    pressure = dive_and_climb()
    assert fragment in reason_of(change(cast(pressure, thermocline(pressure), 35.0)))


def spiked(values, spike):
    values = values.copy()
    values[::200] = spike
    return values


def alternating(record):
    """Temperature and salinity are never measured in the same sample; the other one is zero, or a fill value."""
    even = np.arange(len(record.pressure)) % 2 == 0
    return replace(
        record,
        temperature=np.where(even, record.temperature, 999.0),
        practical_salinity=np.where(even, 0.0, record.practical_salinity),
    )


def test_salinities_of_zero_are_missing():
    pressure = dive_and_climb()
    record = cast(pressure, thermocline(pressure), 35.0)
    off = replace(record, practical_salinity=np.where((pressure > 250.0) & (pressure < 320.0), 0.0, 35.0))
    np.testing.assert_allclose(water_of(off), water_of(record), atol=0.05)


@pytest.mark.parametrize(("salinity", "density"), [(0.1, 999.8), (0.06, 999.8), (5.0, 1003.6)])
def test_lakes_and_brackish_water_are_measured(salinity, density):
    pressure = dive_and_climb()
    assert water_of(cast(pressure, 8.0, salinity))[0, DENSITY] == pytest.approx(density, abs=0.3)


def test_a_density_far_from_that_of_the_platform_is_reported():
    """Only if the buoyancy uses it: then the hull is not the only suspect."""
    pressure = dive_and_climb()
    sea, half = (on_steps(cast(pressure, thermocline(pressure), s), EstimationSettings()) for s in (35.0, 17.5))
    doubt = describe_unexpected_density(SOFT, half)
    assert "kg/m3 (median, at surface pressure) and the platform file 1025" in doubt
    assert doubt.endswith("check the record's practical_salinity and temperature")
    assert describe_unexpected_density(SOFT, sea) is None
    assert describe_unexpected_density(PETREL, half) is None
    assert describe_unexpected_density(with_overrides(SOFT, {"buoyancy.water_density": "1012.5"}), half) is None


def test_a_filter_that_cannot_follow_names_the_water_too():
    """The hull is too heavy everywhere in water that is too light by the record."""
    settings = EstimationSettings.model_validate({"filter": {"max_rejected_fraction": 1e-6}})
    record, _ = simulate_profile(SOFT, STRATIFIED, 5)
    with pytest.raises(ProfileError) as refused:
        run_filter(prepare_profile(Glider(SOFT), on_steps(freshened(record), settings)), settings)
    assert "check the platform (neutral volume, battery zero)" in str(refused.value)
    assert "check the record's practical_salinity and temperature" in str(refused.value)


def freshened(record):
    return replace(record, practical_salinity=record.practical_salinity - 25.0)


def test_gaps_that_are_narrow_for_their_depth_are_bridged():
    pressure = dive_and_climb()
    record = cast(pressure, thermocline(pressure), 35.0)
    np.testing.assert_allclose(water_of(punctured(record, 250.0, 320.0)), water_of(record), atol=0.05)


# The choice


def test_auto_needs_ctd_and_compressibility_and_else_changes_nothing():
    pressure = dive_and_climb()
    record = cast(pressure, thermocline(pressure), 35.0)
    known, unknown = (on_steps(r, EstimationSettings()) for r in (record, replace(record, temperature=None)))
    plain = on_steps(record, EstimationSettings(seawater="depth_slope"))
    assert plain.seawater is None
    assert plain.without_seawater == ""
    for hull, series, columns in ((SOFT, known, 6), (PETREL, known, 5), (SOFT, unknown, 5), (SOFT, plain, 5)):
        assert controls_of(hull, series).shape[1] == columns
    np.testing.assert_array_equal(controls_of(PETREL, known), controls_of(PETREL, plain))
    weights = [Glider(SOFT).bodies(controls_of(SOFT, series))[:, 9] for series in (known, plain)]
    excess = excess_weight(SOFT, known.controls[:, 2], known.seawater)
    np.testing.assert_allclose(weights[0] - weights[1], excess, atol=1e-12)


def test_density_that_is_asked_for_and_not_there_is_refused():
    pressure = dive_and_climb()
    record = cast(pressure, thermocline(pressure), None, practical_salinity=None)
    asked = EstimationSettings(seawater="density")
    with pytest.raises(ProfileError, match=r"profile 7: no practical_salinity, but seawater=density .*seawater=auto"):
        on_steps(record, asked)
    with pytest.raises(InputError, match=r"petrel-l states no buoyancy\.compressibility"):
        check_seawater(PETREL, asked)
    check_seawater(SOFT, asked)


# The stratified ocean


def test_the_ocean_s_weight_is_the_estimator_s_by_another_way():
    """Exact Gibbs function against the 75-term equation (within 1e-3 kg/m3), and the weights' two formulae."""
    column = ocean_column(STRATIFIED.ocean, (18.0, 115.0), 500.0)
    floating = FloatingHull(SOFT, column)
    volume = floating.oil_volume(0.3)
    assert floating.net_mass(0.0, volume) == pytest.approx(0.3)
    record = cast(column.pressure, column.temperature, column.practical_salinity, entry_fix=Fix(EPOCH, 18.0, 115.0))
    water = water_of(replace(record, depth=column.depth))[40:-40:400]
    expected = [GRAVITY * floating.net_mass(depth, volume) for depth in water[:, 0]]
    known = -GRAVITY * SOFT.buoyancy.water_density * (volume - SOFT.buoyancy.neutral_volume_m3)
    found = known + excess_weight(SOFT, volume, water) - SOFT.buoyancy.depth_slope * water[:, 0]
    np.testing.assert_allclose(found, expected, atol=0.01)
    slope = floating.depth_slope(80.0, volume, 0.5)
    assert slope == pytest.approx(
        GRAVITY * (floating.net_mass(79.5, volume) - floating.net_mass(80.5, volume)), rel=1e-12
    )


def test_a_hull_that_does_not_say_how_it_is_compressed_is_simulated_with_typical_values(tmp_path):
    assert PETREL.buoyancy.compressibility is None
    brief = STRATIFIED.replaced({"depth": 60.0, "profiles": 1})
    stated = with_overrides(PETREL, {"buoyancy.compressibility": "4.5e-6", "buoyancy.thermal_expansion": "6e-5"})
    (first, _), (second, _) = (simulate_profile(hull, brief, 0) for hull in (PETREL, stated))
    np.testing.assert_array_equal(first.depth, second.depth)
    np.testing.assert_array_equal(first.pitch, second.pitch)
    options = ("--scenario", "stratified", "--profiles", 1, "--depth", 60)
    answer = program("simulate-mission", tmp_path / "o.nc", "--platform", "petrel-l", *options)
    assert answer.status == 0
    assert "states no buoyancy.compressibility; it is simulated with the usual 4.5e-06 1/dbar" in answer.err


@pytest.fixture(scope="module")
def flown():
    return simulate_profile(SOFT, STRATIFIED, 1)


def common_heave(record, way):
    """Filter's heave disturbance common to dive and climb (N): due to buoyancy, and not to lift and drag."""
    settings = EstimationSettings(seawater=way)
    series = on_steps(record, settings)
    prepared = prepare_profile(Glider(SOFT), series)
    heave = run_filter(prepared, settings).disturbances[:, 2]
    up = np.arange(len(heave)) > np.argmax(series.measurements[:, 3])
    counted = ~prepared.vibrating & (series.time > 120.0)
    return 0.5 * (np.median(heave[counted & up]) + np.median(heave[counted & ~up]))


def test_the_heave_bias_of_a_stratified_ocean_vanishes_with_density_and_not_with_the_slope(flown):
    """There is no disturbance, so the heave channel has to compensate the error of buoyancy."""
    record, truth = flown
    assert np.abs(truth.disturbances).max() == 0.0
    assert abs(common_heave(record, "density")) < 0.06
    assert abs(common_heave(record, "depth_slope")) > 0.5


def test_spikes_of_the_twin_s_salinity_are_there(flown):
    """20 an hour of about 1: the record that the test above flies on is no clean one."""
    salinity = flown[0].practical_salinity
    assert np.count_nonzero(np.abs(salinity - np.median(salinity)) > 0.5) > 3


def test_the_forward_model_follows_by_density(flown):
    """As `validate` flies it: open loop under the recorded controls."""
    errors = []
    for way in ("density", "depth_slope"):
        series = on_steps(flown[0], EstimationSettings(seawater=way))
        half = int(np.argmax(series.measurements[:, 3]))
        depth = run_forward(Glider(SOFT), series).states[:half, 5]
        errors.append(float(np.sqrt(np.mean((depth - series.measurements[:half, 3]) ** 2))))
    assert errors[0] < 8.0
    assert errors[1] > 3.0 * errors[0]


# Missions


@pytest.fixture(scope="module")
def ocean_mission(tmp_path_factory):
    """Two brief profiles in a stratified ocean, the second without salinity; and the hull's file."""
    folder = tmp_path_factory.mktemp("ocean")
    scenario = read_scenario(
        {**STRATIFIED.model_dump(), "depth": 60.0, "ocean": {"thermocline": 30.0, "thickness": 5.0}}
    )
    simulate_mission(SOFT, folder / "whole.nc", scenario=scenario, seed=2)

    def lose_salinity(content):
        content["practical_salinity"][content["profile"].values == 2] = np.nan

    changed_observations(folder / "whole.nc", folder / "twin.nc", lose_salinity)
    (folder / "soft.yaml").write_text(platform_yaml(SOFT))
    return folder


@pytest.fixture(scope="module")
def ocean_store(ocean_mission):
    store = ocean_mission / "lanes.zarr"
    estimate(ocean_mission / "twin.nc", store, "recommended", platform=str(ocean_mission / "soft.yaml"))
    return store


def test_a_profile_that_fell_back_to_the_depth_slope_is_warned_of(ocean_mission, caplog):
    rows = {number: {"status": "done", "buoyancy": number % 2} for number in (1, 2, 3, 4)}
    _warn_about_depth_slope(SOFT, MissionResult(rows=rows | {5: {"status": "failed"}}))
    (warning,) = caplog.messages
    assert warning.startswith("profile 2, 4: buoyancy from the depth slope, not from density")
    assert SLOPE_BIAS in warning
    caplog.clear()
    _warn_about_depth_slope(read_platform("petrel-l"), MissionResult(rows=rows))
    assert caplog.messages == []
    series = profile_series(ocean_mission / "twin.nc", 1, EstimationSettings(seawater="depth_slope"))
    assert buoyancy_remarks(SOFT, series) == [
        f"buoyancy from the depth slope, not from density: by the setting seawater, and {SLOPE_BIAS}"
    ]
    assert buoyancy_remarks(read_platform("petrel-l"), series) == []


def test_the_archive_says_what_was_used(ocean_mission, ocean_store):
    check_archive(ocean_store)
    with open_mission(ocean_store) as archive:
        table, observed = archive.to_dataset(), archive["observed"].to_dataset()
        assert table["buoyancy"].values.tolist() == [1, 0]
        assert table["buoyancy"].attrs["flag_meanings"] == "depth_slope density"
        assert str(table["message"].values[0]) == ""
        assert str(table["message"].values[1]) == (
            f"buoyancy from the depth slope, not from density: no practical_salinity, and {SLOPE_BIAS}"
        )
        assert np.isnan(observed["water_density"].sel(profile=2)).all()
        assert archive.attrs["settings"]["seawater"] == "auto"
        data = read_profile_data(archive, 1)
        rebuilt = series_of(data, SOFT)
    series = profile_series(ocean_mission / "twin.nc", 1, EstimationSettings())
    np.testing.assert_allclose(rebuilt.seawater, series.seawater[:-1:10][: len(rebuilt.seawater)], atol=0.1)
    weights = [controls_of(SOFT, s)[:, 5] for s in (rebuilt, series)]
    np.testing.assert_allclose(weights[0], weights[1][:-1:10][: len(weights[0])], atol=0.01)


def test_studies_go_by_what_the_archive_says(ocean_mission, ocean_store):
    """`validate` flies either way; an inversion with k_z = 0 is for the profile that went by the slope alone."""
    observations, hull = ocean_mission / "twin.nc", ocean_mission / "soft.yaml"
    flown = program("validate", observations, "--platform", hull, "--store", ocean_store, "--workers", 0)
    assert flown.status == 0, flown.err
    study = program("analyze", ocean_store, "reconstruction", "--observations", observations, "--workers", 0)
    assert study.status == 0, study.err
    with open_mission(ocean_store) as archive:
        depth = archive["validation"]["depth_rmse"].values
        slope = archive["reconstruction"]["no_slope_heave_slope"].values
    assert np.isfinite(depth).all()
    assert np.isfinite(slope).tolist() == [False, True]


@pytest.mark.compiled
def test_engines_agree_on_density(ocean_mission, ocean_store):
    store = ocean_mission / "scipy.zarr"
    estimate(ocean_mission / "twin.nc", store, "recommended", {"engine": "scipy"}, str(ocean_mission / "soft.yaml"))
    heave = []
    for path in (ocean_store, store):
        with open_mission(path) as archive:
            heave.append(archive["series"]["B_cw"].sel(profile=1).values.astype(float))
    known = np.isfinite(heave[0])
    difference = heave[0][known] - heave[1][known]
    assert np.sqrt(np.mean(difference**2)) < 0.1 * np.std(heave[0][known])


def test_a_mission_without_compressibility_is_reported_and_as_before(ocean_mission, tmp_path, caplog):
    stores = []
    with caplog.at_level("INFO", "gliderhpc.mission.run"):
        for way in ("auto", "depth_slope"):
            stores.append(tmp_path / f"{way}.zarr")
            estimate(ocean_mission / "twin.nc", stores[-1], "recommended", {"seawater": way})
    assert sum("states no buoyancy.compressibility" in line for line in caplog.messages) == 1
    with open_mission(stores[0]) as auto, open_mission(stores[1]) as slope:
        xr.testing.assert_identical(auto["series"].to_dataset(), slope["series"].to_dataset())


def test_the_program_refuses_density_for_a_hull_without_compressibility(ocean_mission, tmp_path):
    answer = program(
        "run-mission", ocean_mission / "twin.nc", "--platform", "petrel-l", "--store", tmp_path / "out.zarr",
        "--set", "seawater=density",
    )  # fmt: skip
    assert answer.status == 2
    assert "--set seawater=density: the platform petrel-l states no buoyancy.compressibility" in answer.line


# Calibration


@pytest.fixture(scope="module")
def ocean_segments():
    """Steady segments of three dives to 300 m in the stratified ocean."""
    settings, scenario = EstimationSettings(), STRATIFIED.replaced({"depth": 300.0})
    records = [simulate_profile(SOFT, scenario, 5, number=number)[0] for number in (1, 2, 3)]
    return join_segments([segments_of(on_steps(record, settings), SOFT, SegmentSettings()) for record in records])


def test_calibration_finds_neutral_volume_and_compressibility(ocean_segments):
    wrong = with_overrides(
        SOFT, {"buoyancy.compressibility": "3.5e-6", "buoyancy.neutral_volume": "650", "viscous.K_D0": "8.0"}
    )
    free = {"buoyancy.neutral_volume", "buoyancy.compressibility", "viscous.K_D0"}
    hold = tuple(p.key for p in PARAMETERS_BY_DENSITY if p.key not in free)
    found = calibrate_on_glides(wrong, ocean_segments, ocean_segments.empty(), CalibrationSettings(hold=hold))
    values = {p.parameter.key: p for p in found.parameters}
    assert "buoyancy.depth_slope" not in values
    assert found.platform.buoyancy.neutral_volume == pytest.approx(PETREL.buoyancy.neutral_volume, abs=8.0)
    assert found.platform.buoyancy.compressibility == pytest.approx(4.5e-6, abs=0.5e-6)
    low, high = values["buoyancy.compressibility"].interval
    assert low < 4.5e-6 < high
    assert found.fitted.after[0] < 0.5 * found.fitted.before[0]


def test_a_calibration_s_buoyancy_goes_one_way(ocean_segments):
    none = ocean_segments.empty()
    reported = []
    hull, usable, _ = choose_buoyancy(PETREL, ocean_segments, none, "auto", reported.append)
    assert hull.buoyancy.compressibility == TYPICAL_COMPRESSIBILITY
    assert len(usable) == len(ocean_segments)
    assert reported == []
    partly = replace(ocean_segments, seawater=ocean_segments.seawater.copy())
    partly.seawater[ocean_segments.profile == 2] = np.nan
    hull, usable, _ = choose_buoyancy(SOFT, partly, none, "density", reported.append)
    assert hull == SOFT
    assert set(usable.profile.tolist()) == {1, 3}
    assert reported.pop() == "profile 2 is left out: the density of its water is not known"
    # Two profiles are too few for a calibration.
    hull, usable, _ = choose_buoyancy(SOFT, partly, none, "auto", reported.append)
    assert hull.buoyancy.compressibility is None
    assert set(usable.profile.tolist()) == {1, 2, 3}
    assert "of the steady flight, in 2 profiles, has a known density" in reported.pop()
    for segments, way in ((ocean_segments, "depth_slope"), (partly.select(partly.profile == 2), "auto")):
        hull, usable, _ = choose_buoyancy(SOFT, segments, none, way)
        assert hull.buoyancy.compressibility is None
        assert not usable.in_known_water.any()
    rejected = replace(partly, without_seawater=np.where(partly.in_known_water, "", "no temperature"))
    choose_buoyancy(SOFT, rejected, none, "density", reported.append)
    assert reported.pop() == "profile 2 is left out: the density of its water is not known (no temperature)"
    choose_buoyancy(SOFT, rejected.select(rejected.profile == 2), none, "auto", reported.append)
    assert reported.pop() == "buoyancy from the depth slope: no steady flight has a known density (no temperature)"
    with pytest.raises(InputError, match="no steady flight of the chosen profiles has a known density"):
        choose_buoyancy(PETREL, partly.select(partly.profile == 2), none, "density")


def test_a_hull_is_neutral_in_the_fresh_water_that_it_flies_in(ocean_segments):
    """Unless its file states a compressibility: then its neutral volume is that of the file's density."""
    none, reported = ocean_segments.empty(), []
    lake = replace(ocean_segments, seawater=ocean_segments.seawater - np.array([0.0, 25.0, 0.0, 0.0]))
    hull, _, _ = choose_buoyancy(PETREL, lake, none, "auto", reported.append)
    _, density, _, pressure = lake.seawater.T
    assert hull.buoyancy.water_density == pytest.approx(np.median(density / (1.0 + 4.5e-6 * pressure)), abs=0.1)
    assert hull.buoyancy.neutral_volume == PETREL.buoyancy.neutral_volume
    assert "its neutral volume is referred to this density" in reported[0]
    assert choose_buoyancy(SOFT, lake, none, "auto")[0] == SOFT


# Real records


def test_every_dive_of_a_real_mission_has_its_density(shared_data, tmp_path):
    import_seaexplorer([shared_data / "seaexplorer-sea035-M012"], tmp_path / "m12.nc")
    settings = EstimationSettings()
    with open_observations(tmp_path / "m12.nc") as opened:
        numbers = [number for number in opened.profile_numbers if number not in opened.faults]
        series = [on_steps(opened.profile(number), settings) for number in numbers]
    assert len(series) == 11
    for one in series:
        assert one.seawater is not None, one.without_seawater
        density, pressure = one.seawater[:, DENSITY], one.seawater[:, PRESSURE]
        assert 1023.0 < density.min() < 1024.5
        assert density.max() == pytest.approx(1027.3 + 4.45e-3 * pressure.max(), abs=0.4)
        assert math.isclose(one.seawater[:, 0].max(), one.measurements[:, 3].max(), rel_tol=1e-3)
