"""Platform files: accepted content, refused content, and the names in messages."""

import math
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from gliderhpc.errors import InputError
from gliderhpc.platform import ballast_masses, read_platform, shipped_platforms, with_overrides
from gliderhpc.platform_ranges import check_plausible
from gliderhpc.platform_sections import CalibrationErrors, Uncertainty

PETREL = (Path(__file__).parents[2] / "gliderhpc" / "platforms" / "petrel-l.yaml").read_text("utf-8")


@pytest.fixture
def altered(tmp_path):
    """Write petrel-l with one piece of its text replaced, and return the path."""

    def write(old: str, new: str) -> Path:
        assert old in PETREL
        path = tmp_path / "hull.yaml"
        path.write_text(PETREL.replace(old, new), "utf-8")
        return path

    return write


def test_shipped_hulls_are_all_valid():
    names = shipped_platforms()
    assert names == ["petrel-l", "seaexplorer", "seaglider", "seawing", "slocum"]
    assert [read_platform(name).name for name in names] == names


def test_units_are_those_of_the_file_and_properties_are_si():
    platform = read_platform("petrel-l")
    assert platform.buoyancy.neutral_volume == 700.0
    assert platform.buoyancy.neutral_volume_m3 == pytest.approx(700e-6)
    assert platform.sensors.attitude_resolution_rad == pytest.approx(math.radians(0.1))
    assert platform.vibration.ballast_rate_m3 == pytest.approx(1e-6)
    assert platform.vibration.battery_rotation_rate_rad == pytest.approx(math.radians(0.5))


def test_optional_keys():
    assert read_platform("petrel-l").viscous.K_L0 == 0.0
    assert read_platform("seawing").viscous.K_L0 == -0.36
    assert read_platform("petrel-l").prior is None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("depth_noise: 0.03", "depth_noise: 3", r"sensors\.depth_noise is 3 m, but plausible is .* 0 to 1\.2 m;"),
        (
            "inertia: [0.84, 26.8, 26.7]",
            "inertia: [0.84, 2680, 2680]",
            r"inertia\.1 is 2680 kg m2, .* of 88\.09 kg is a",
        ),
        ("K_D: 415.0", "K_D: 41500", r"viscous\.K_D is 41500 kg/m/rad2, but plausible"),
        (
            "neutral_volume: 700.0",
            "neutral_volume: 7e5",
            r"neutral_volume is 700000 cm3, .*; correct it, or convert it to",
        ),
        ("battery_eccentricity: 0.0172", "battery_eccentricity: 17.2", r"battery_eccentricity is 17\.2 m"),
        (
            "{total: 88.09, hull: 66.92, battery: 20.37}",
            "{total: 88090, hull: 66920, battery: 20370}",
            r"is 88090 kg, but",
        ),
    ],
)
def test_numbers_that_no_glider_has_are_refused(altered, old, new, message):
    with pytest.raises(InputError, match=rf"hull\.yaml: .*{message}"):
        read_platform(altered(old, new))


@pytest.mark.parametrize("factor", [20.0 / 88.09, 500.0 / 88.09])
def test_hulls_of_other_sizes_and_with_unusual_numbers_are_plausible(factor):
    """Of the same shape, or with any coefficient ten times larger or smaller."""
    length = factor ** (1.0 / 3.0)
    hull = read_platform("petrel-l")
    grown = with_overrides(
        hull,
        {f"mass.{part}": factor * value for part, value in hull.mass.model_dump().items()}
        | {"inertia": [length**5 * value for value in hull.inertia]}
        | {"added_mass": [factor * value for value in hull.added_mass]}
        | {"added_inertia": [length**5 * value for value in hull.added_inertia]}
        | {f"viscous.{name}": length**2 * getattr(hull.viscous, name) for name in ("K_D0", "K_D", "K_beta", "K_L")},
    )
    check_plausible("made", grown)
    for name in ("K_D0", "K_L", "K_beta", "K_D", "K_q", "K_r", "K_M", "K_MY"):
        for other in (0.1, 10.0):
            check_plausible("made", with_overrides(hull, {f"viscous.{name}": other * getattr(hull.viscous, name)}))


def test_prior_is_six_by_six(altered):
    good = "vibration:"
    prior = "prior: {deviation: [1, 1, 1, 1, 1, 1e-1], correlation_time: [1, 2, 3, 4, 5, 6]}\nvibration:"
    assert read_platform(altered(good, prior)).prior.deviation[5] == 0.1
    with pytest.raises(InputError, match=r"prior\.deviation is .*list of 6 numbers"):
        read_platform(altered(good, prior.replace("1, 1, 1, ", "1, ", 1)))


def test_platform_is_immutable():
    platform = read_platform("petrel-l")
    with pytest.raises(ValidationError):
        platform.mass.total = 1.0


def test_path_is_read_like_a_name(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(PETREL, "utf-8")
    assert read_platform(path) == read_platform(str(path)) == read_platform("petrel-l")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("K_D0: 8.86", "K_D0: -8.86", r"viscous\.K_D0 is -8\.86 .*greater than 0"),
        ("K_D: 415.0", "K_D: -1", r"viscous\.K_D is -1 .*at least 0"),
        ("K_L: 442.0", "K_L: -442.0", r"viscous\.K_L is -442\.0 .*greater than 0"),
        ("oil_density: 870.0", "oil_density: 0.87", r"oil_density is 0\.87 .*kg/m3\): it must be at least 500"),
        ("oil_density: 870.0", "oil_density: 8700", r"oil_density is 8700 .*at most 2000"),
        (
            "water_density: 1025.0",
            "water_density: 1.025",
            r"water_density is 1\.025 .*kg/m3\): it must be at least 950",
        ),
        ("water_density: 1025.0", "water_density: 10250", r"water_density is 10250 .*at most 1100"),
        ("depth_noise: 0.03", "depth_noise: 30", r"depth_noise is 30 .*, m\): it must be at most 10"),
        ("attitude_resolution: 0.1", "attitude_resolution: 100", r"attitude_resolution is 100 .*at most 10"),
        (
            "sample_interval: 1.0",
            "sample_interval: 100000",
            r"sample_interval is 100000 .*, s\): it must be at most 3600",
        ),
        ("K_beta: -116.0", "K_beta: 116.0", r"viscous\.K_beta is 116\.0 .*less than 0"),
        ("K_p: -25.4", "K_p: 25.4", r"viscous\.K_p is 25\.4 .*at most 0"),
        ("K_q: -263.0", "K_q: 263.0", r"viscous\.K_q is 263\.0 .*at most 0"),
        ("K_r: -330.0", "K_r: 330.0", r"viscous\.K_r is 330\.0 .*at most 0"),
        ("K_MR: -69.5,", "", r"missing key 'viscous\.K_MR' \(roll moment over sideslip"),
        ("K_MR: -69.5", "K_MRR: -69.5", r"unknown key 'viscous\.K_MRR', did you mean 'viscous\.K_MR'\?"),
        ("hull: 66.92", "hull: -66.92", r"mass\.hull is -66\.92 .*greater than 0"),
        ("inertia: [0.84,", "inertia: [-0.84,", r"inertia is -0\.84 .*greater than 0"),
        ("added_mass: [1.65,", "added_mass: [-1.65,", r"added_mass is -1\.65 .*at least 0"),
        ("inertia: [0.84, 26.8, 26.7]", "inertia: [0.84, 26.8]", r"inertia .* list of 3 numbers"),
        ("inertia: [0.84, 26.8, 26.7]", "inertia: 3.0", r"inertia .* list of 3 numbers"),
        ("depth_noise: 0.03", "depth_noise: 0.03, heading_deviation: [1, 2]", r"deviation is .* list of 4 numbers"),
        (
            "name: petrel-l\n",
            "name: petrel-l\nuncertainty: {covariance: {parameters: 1, deviation: [1], correlation: [[]]}}\n",
            r"parameters is 1: it must be a list, as",
        ),
        ("total: 88.09", "total: heavy", r"mass\.total is 'heavy' .*finite number"),
        ("total: 88.09", "total: .nan", r"mass\.total is nan .*finite number"),
        ("total: 88.09", "total: yes", r"mass\.total is True .*must be a number"),
        ("depth_slope: 0.005", "depth_slope: 0.005, compressibility: 1", r"compressibility is 1 .*less than 0\.0001"),
        ("depth_slope: 0.005", "depth_slope: 0.005, thermal_expansion: -1e-5", r"thermal_expansion .*at least 0"),
        ("sensors: {attitude_resolution: 0.1, depth_noise: 0.03, sample_interval: 1.0}", "sensors: 1", r"sensors is 1"),
        ("name: petrel-l\n", "", r"missing key 'name'"),
        (
            "total: 88.09",
            "total: 1.0",
            r"hull\.yaml: mass\.total is 1 .*at least that of mass\.hull and mass\.battery .*87\.29",
        ),
        (
            "inertia: [0.84, 26.8, 26.7]",
            "inertia: [1, 1, 1000]",
            r"hull\.yaml: inertia is \[1, 1, 1000\] .*1000 is more than 2",
        ),
        ("inertia: [0.84, 26.8, 26.7]", "inertia: [0.84, 31, 26.7]", r"each must be at most the sum of the other two"),
        (
            "name: petrel-l\n",
            "name: petrel-l\nuncertainty: {deviation: {viscous.K_XX: 0.1}}\n",
            r"hull\.yaml: there is no number 'viscous\.K_XX', which uncertainty\.deviation names, did you mean",
        ),
        (
            "name: petrel-l\n",
            "name: petrel-l\nuncertainty: {walk: {position.hul.2: 0.1}}\n",
            r"which uncertainty\.walk names, did you mean 'position\.hull\.2'\?; correct the key$",
        ),
        (
            "name: petrel-l\n",
            "name: petrel-l\ncalibration: {parameters: []}\nuncertainty: {covariance: {parameters: []}}\n",
            r"hull\.yaml: there are both a calibration and an uncertainty\.covariance",
        ),
    ],
)
def test_refusals_name_file_key_and_remedy_on_one_line(altered, old, new, message):
    with pytest.raises(InputError, match=message) as caught:
        read_platform(altered(old, new))
    assert str(caught.value).count("\n") == 0
    assert "hull.yaml: " in str(caught.value)
    assert len(str(caught.value).partition("hull.yaml: ")[2]) < 250


def test_moments_of_inertia_may_be_rounded(altered):
    """Slender hulls have nearly equal moments in pitch and yaw, written with two digits."""
    assert read_platform(altered("inertia: [0.84, 26.8, 26.7]", "inertia: [0.84, 28, 26]")).inertia == (
        0.84,
        28.0,
        26.0,
    )


def test_several_faults_are_counted(altered):
    path = altered("hull: 66.92, battery: 20.37", "hull: -1, battery: -2")
    with pytest.raises(InputError, match=r"mass\.hull is -1.*\(and 1 more fault\)"):
        read_platform(path)


def test_compressibility_is_none_until_it_is_stated(altered):
    """A rigid hull states a zero; a hull that states nothing uses its depth slope."""
    platform = read_platform(
        altered("depth_slope: 0.005", "depth_slope: 0.005, compressibility: 0, thermal_expansion: 5e-5")
    )
    assert (platform.buoyancy.compressibility, platform.buoyancy.thermal_expansion) == (0.0, 5e-5)
    plain = read_platform("petrel-l").buoyancy
    assert (plain.compressibility, plain.thermal_expansion) == (None, 0.0)


def test_unknown_name_lists_hulls_and_nearest():
    with pytest.raises(
        InputError, match=r"unknown platform 'petrel-k', did you mean 'petrel-l'\?; shipped are petrel-l"
    ):
        read_platform("petrel-k")


def test_unreadable_files(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        read_platform(tmp_path / "absent.yaml")
    with pytest.raises(InputError, match="cannot be read"):
        read_platform(tmp_path)
    (tmp_path / "binary.yaml").write_bytes(b"\x89HDF\xff\xfe")
    with pytest.raises(InputError, match="not a text file"):
        read_platform(tmp_path / "binary.yaml")
    (tmp_path / "bad.yaml").write_text("name: [petrel\nmass: }")
    with pytest.raises(InputError, match="not YAML at line 2"):
        read_platform(tmp_path / "bad.yaml")
    (tmp_path / "list.yaml").write_text("- 1\n- 2\n")
    with pytest.raises(InputError, match="not a platform file"):
        read_platform(tmp_path / "list.yaml")


def test_overrides_replace_values_and_are_validated():
    platform = read_platform("seaexplorer")
    changed = with_overrides(platform, {"buoyancy.neutral_volume": "-215", "inertia": "[1, 2, 3]"})
    assert changed.buoyancy.neutral_volume == -215.0
    assert changed.inertia == (1.0, 2.0, 3.0)
    assert platform.buoyancy.neutral_volume == 0.0
    assert with_overrides(platform, {}) is platform


def test_overrides_can_add_a_prior():
    six = "[1, 1, 1, 1, 1, 1]"
    changed = with_overrides(read_platform("petrel-l"), {"prior.deviation": six, "prior.correlation_time": six})
    assert changed.prior is not None
    assert changed.prior.deviation == (1.0,) * 6


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("buoyancy.neutral_volum", "1", r"no key 'buoyancy\.neutral_volum', did you mean 'buoyancy\.neutral_volume'\?"),
        ("buoyancy", "1", "no key 'buoyancy'"),
        ("viscous.K_D0", "-1", r"`platform\.viscous\.K_D0=-1`: viscous\.K_D0 is -1 "),
        ("viscous.K_D0", "much", "finite number"),
        ("inertia", "[1, 2", "neither a number nor a list"),
    ],
)
def test_bad_overrides_are_one_clear_line(key, value, message):
    with pytest.raises(InputError, match=message) as caught:
        with_overrides(read_platform("petrel-l"), {key: value})
    assert str(caught.value).count("\n") == 0


def test_ballast_masses_follow_model_1():
    platform = read_platform("petrel-l")
    volume = np.array([200e-6, 700e-6, 1200e-6])
    m_b, m_m = ballast_masses(platform, volume)
    np.testing.assert_allclose(m_b, (870.0 - 1025.0) * volume)
    np.testing.assert_allclose(m_b + m_m, -1025.0 * (volume - 700e-6), atol=1e-12)


def test_rounded_correlations_leave_no_negative_variance():
    """Three numbers correlated by 1, rounded so that they contradict one another by less than a file's rounding."""
    rounded = CalibrationErrors(
        parameters=("a", "b", "c"), deviation=(1.0, 2.0, 0.5), correlation=((), (0.9999,), (0.9999, 0.9989))
    )
    assert np.linalg.eigvalsh(rounded.correlation_matrix)[0] < -1e-4
    covariance = rounded.covariance
    assert np.linalg.eigvalsh(covariance)[0] > -1e-12
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), rounded.deviation, rtol=1e-12)
    np.testing.assert_allclose(covariance, np.outer(rounded.deviation, rounded.deviation), atol=2e-3)
    np.linalg.cholesky(covariance + 1e-9 * np.eye(3))


def test_correlations_that_are_sound_are_taken_as_they_are():
    sound = CalibrationErrors(parameters=("a", "b"), deviation=(1.0, 2.0), correlation=((), (-0.3,)))
    np.testing.assert_array_equal(sound.covariance, [[1.0, -0.6], [-0.6, 4.0]])


@pytest.mark.parametrize("name", shipped_platforms())
def test_equal_hulls_have_equal_hashes(name):
    """A calibrated hull contains dictionaries, and is the key of the studies' caches."""
    hull = read_platform(name)
    errors = CalibrationErrors(parameters=("viscous.K_D0",), deviation=(0.5,), correlation=((),))
    uncertain = Uncertainty(deviation={"viscous.K_L": 0.3}, covariance=errors)
    calibrated, again = (hull.model_copy(update={"uncertainty": uncertain}) for _ in range(2))
    assert hash(calibrated) == hash(again)
    assert calibrated == again != hull
    assert hash(calibrated) != hash(hull)
