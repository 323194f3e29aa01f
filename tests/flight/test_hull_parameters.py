"""Catalogue of possible errors of a hull, and the platform file's section on them."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from gliderhpc.errors import InputError
from gliderhpc.flight.glider import load_platform
from gliderhpc.flight.hull_parameters import (
    PARAMETERS,
    PARAMETERS_BY_DENSITY,
    RECORD_PARAMETERS,
    compressible,
    errors_in_units,
    hull_parameters,
    moved_platform,
    stated_covariance,
    with_covariance,
    with_values,
)
from gliderhpc.platform import platform_yaml, read_platform, shipped_platforms
from gliderhpc.platform_sections import CalibrationErrors
from gliderhpc.vocabulary import HULL_PARAMETERS

PETREL = read_platform("petrel-l")
ERRORS = CalibrationErrors(
    parameters=("viscous.K_D0", "buoyancy.neutral_volume"), deviation=(0.5, 2.0), correlation=((), (0.5,))
)


def of(key, platform=PETREL):
    return next(p for p in hull_parameters(platform) if p.key == key)


@pytest.mark.parametrize("name", shipped_platforms())
def test_an_override_with_the_same_value_does_not_change_the_parameters_of_the_hull(name):
    plain = read_platform(name)
    same = load_platform(name, {"sensors.depth_noise": plain.sensors.depth_noise})
    assert [p.key for p in hull_parameters(same)] == [p.key for p in hull_parameters(plain)]
    assert compressible(same).buoyancy == compressible(plain).buoyancy
    assert platform_yaml(same) == platform_yaml(plain)


def test_the_archive_s_parameters_are_the_catalogue_s():
    """Every key that any hull may vary, and no other."""
    keys = {p.key for p in (*PARAMETERS, *PARAMETERS_BY_DENSITY)}
    keys |= {p.key for name in shipped_platforms() for p in hull_parameters(read_platform(name))}
    assert keys <= set(HULL_PARAMETERS)
    assert set(HULL_PARAMETERS) - keys <= {"viscous.K_L0"}
    assert len(set(HULL_PARAMETERS)) == len(HULL_PARAMETERS)


@pytest.mark.parametrize("name", shipped_platforms())
def test_every_parameter_moves_one_number_and_back(name):
    platform = read_platform(name)
    parameters = hull_parameters(platform)
    assert len({p.key for p in parameters}) == len(parameters)
    for i, parameter in enumerate(parameters):
        eta = np.zeros(len(parameters))
        eta[i] = 0.7
        moved = moved_platform(platform, parameters, eta)
        assert parameter.value(moved) == parameter.moved(platform, 0.7)
        assert parameter.value(moved) != parameter.value(platform)
        assert parameter.steps(platform, parameter.value(moved)) == pytest.approx(0.7, rel=1e-9)
        assert with_values(moved, {parameter.key: parameter.value(platform)}) == platform


@pytest.mark.parametrize("parameter", hull_parameters(PETREL), ids=lambda p: p.key)
def test_slope_is_the_derivative_of_moved(parameter):
    difference = parameter.moved(PETREL, 0.3 + 1e-5) - parameter.moved(PETREL, 0.3 - 1e-5)
    assert parameter.slope(PETREL, 0.3) == pytest.approx(difference / 2e-5, rel=1e-6)


def test_a_factor_beyond_all_numbers_is_infinite_and_a_missing_one_stays_missing():
    """So are the ends of the interval of a quantity that a calibration does not determine, which must not end it."""
    assert of("viscous.K_r").moved(PETREL, 1e5) == -np.inf
    assert of("viscous.K_r").moved(PETREL, -1e5) == 0.0
    assert np.isnan(of("viscous.K_r").moved(PETREL, np.nan))


def test_a_parameter_that_does_not_act_is_left_out():
    still = with_values(PETREL, {"viscous.K_q": 0.0})
    assert {p.key for p in hull_parameters(PETREL)} - {p.key for p in hull_parameters(still)} == {"viscous.K_q"}


def test_lift_offset_and_rudder_count_where_the_file_states_them():
    assert "viscous.K_L0" in {p.key for p in hull_parameters(read_platform("seawing"))}
    keys = {p.key for p in hull_parameters(PETREL)}
    assert keys.isdisjoint({"viscous.K_L0", "viscous.K_delta"})
    assert "viscous.K_delta" in {p.key for p in hull_parameters(with_values(PETREL, {"viscous.K_delta": 0.0}))}


def test_density_takes_the_depth_slopes_place():
    soft = with_values(PETREL, {"buoyancy.compressibility": 4.5e-6, "buoyancy.thermal_expansion": 6e-5})
    keys = {p.key for p in hull_parameters(soft)}
    assert {"buoyancy.compressibility", "buoyancy.thermal_expansion"} <= keys
    assert "buoyancy.depth_slope" not in keys


def test_errors_of_the_records_are_the_sensors():
    parameters = hull_parameters(PETREL)
    assert parameters[-len(RECORD_PARAMETERS) :] == RECORD_PARAMETERS
    eta = np.array([2.0 * (p.key == "sensors.heading_offset") for p in parameters])
    moved = moved_platform(PETREL, parameters, eta)
    assert moved.sensors.heading_offset == 3.0
    assert moved.viscous == PETREL.viscous


@pytest.fixture
def file_with(tmp_path):
    """Write petrel-l with an uncertainty, and return the path."""

    def write(section: object, **others: object) -> Path:
        path = tmp_path / "hull.yaml"
        content = yaml.safe_load(platform_yaml(PETREL)) | {"uncertainty": section} | others
        path.write_text(yaml.safe_dump(content), "utf-8")
        return path

    return write


def test_the_file_states_deviation_and_walk(file_with):
    section = {"deviation": {"viscous.K_D0": 0.1, "buoyancy.neutral_volume": 30.0}, "walk": {"viscous.K_D0": 0.05}}
    platform = load_platform(file_with(section))
    drag, volume = of("viscous.K_D0", platform), of("buoyancy.neutral_volume", platform)
    assert drag.moved(platform, 1.0) == pytest.approx(PETREL.viscous.K_D0 * np.exp(0.1))
    assert volume.moved(platform, 1.0) == 730.0
    assert drag.walk(platform) == pytest.approx(0.5)
    assert volume.walk(platform) == pytest.approx(volume.usual_walk / 30.0)
    assert of("viscous.K_D0").moved(PETREL, 1.0) == pytest.approx(PETREL.viscous.K_D0 * np.exp(0.4))


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ({"deviation": {"viscous.K_D": -1.0}}, r"uncertainty\.deviation\..*greater than 0"),
        ({"deviation": {"viscous.K_X": 1.0}}, r"no number 'viscous\.K_X', which uncertainty\.deviation names"),
        ({"walk": {"position.hull.3": 1.0}}, r"no number 'position\.hull\.3'"),
        ({"walk": {"mass.total": 1.0}}, r"'mass\.total', which is not a parameter with an uncertainty"),
        ({"covariance": "lost.yaml"}, r"no such file"),
        ({"surprise": 1}, r"unknown key 'uncertainty\.surprise'"),
        (
            {
                "covariance": {
                    "parameters": ["viscous.K_D0", "viscous.K_L", "viscous.K_D"],
                    "deviation": [1, 1, 1],
                    "correlation": [[], [0.9], [0.9, -0.9]],
                }
            },
            "contradict one another",
        ),
    ],
)
def test_a_wrong_section_is_refused_in_one_line(file_with, section, words):
    with pytest.raises(InputError, match=words) as refused:
        load_platform(file_with(section))
    assert "\n" not in str(refused.value)


def test_the_covariance_may_be_a_file_next_to_the_platforms(file_with, tmp_path):
    (tmp_path / "errors.yaml").write_text(yaml.safe_dump(ERRORS.model_dump(mode="json")), "utf-8")
    assert load_platform(file_with({"covariance": "errors.yaml"})).calibration == ERRORS


def test_former_calibrations_still_load(file_with):
    former = load_platform(file_with(None, calibration=ERRORS.model_dump(mode="json")))
    assert former.calibration == ERRORS
    assert former == with_covariance(PETREL, ERRORS)
    assert "calibration:" not in platform_yaml(former)
    with pytest.raises(InputError, match=r"both a calibration and an uncertainty\.covariance"):
        load_platform(
            file_with({"covariance": ERRORS.model_dump(mode="json")}, calibration=ERRORS.model_dump(mode="json"))
        )


def test_a_platform_with_a_covariance_survives_its_file(tmp_path):
    path = tmp_path / "out.yaml"
    path.write_text(platform_yaml(with_covariance(PETREL, ERRORS)), "utf-8")
    assert load_platform(path) == with_covariance(PETREL, ERRORS)


def test_a_covariance_survives_the_platform_file_though_numbers_are_negative():
    """Errors in plausible deviations are the same after a way through the file's units, in which signs differ."""
    parameters = hull_parameters(PETREL)
    rng = np.random.default_rng(5)
    root = rng.standard_normal((len(parameters), len(parameters)))
    covariance = 0.1 * root @ root.T / len(parameters)
    steps = 0.3 * rng.standard_normal(len(parameters))
    hull = moved_platform(PETREL, parameters, steps)
    found = with_covariance(hull, errors_in_units(PETREL, parameters, steps, covariance))
    slopes = np.array([p.slope(hull, 0.0) for p in parameters])
    before = np.array([p.slope(PETREL, x) for p, x in zip(parameters, steps.tolist(), strict=True)])
    assert (slopes < 0.0).sum() > 3
    expected = covariance * np.outer(before / slopes, before / slopes)
    np.testing.assert_allclose(stated_covariance(found, parameters), expected, rtol=1e-4, atol=1e-6)
    # Values that move by a step of the errors have the stated covariance, by differences.
    move = np.linalg.cholesky(covariance) @ rng.standard_normal((len(parameters), 4)) * 1e-3
    values = [
        [p.value(moved_platform(PETREL, parameters, steps + one)) - p.value(hull) for p in parameters] for one in move.T
    ]
    inverse = np.linalg.inv(found.calibration.covariance)
    for one, value in zip(move.T, values, strict=True):
        assert value @ inverse @ value == pytest.approx(one @ np.linalg.inv(covariance) @ one, rel=0.02)
