"""Statistics of the gust field: those of the cascade, compared with its Gaussian twin."""

from functools import cache

import numpy as np
import pytest
from scipy.signal import welch

from gliderhpc.simulator.sections import Gusts
from gliderhpc.simulator.water import gust_field, node_spacing, spectral_slope, with_slopes
from gliderhpc.vocabulary import she_leveque

FIELDS = 40
LENGTH = 2000.0
INERTIAL = 2.0 ** np.arange(0.0, 4.1, 0.5)
"""Separations over which exponents are fitted: 1 to 16 m, an eighth of the largest scale and 16 times the smallest.

Nearer to the smallest scale the missing finer levels raise zeta_6 / zeta_3, by 0.03 at twice that scale.
"""

CASCADE = Gusts(kind="cascade", rms=0.02, outer=128.0, inner=0.0625)
GAUSSIAN = CASCADE.model_copy(update={"kind": "gaussian"})


@cache
def field_of(settings, seed):
    return gust_field(settings, LENGTH, np.random.default_rng([8, seed]))


def fields(settings, count=FIELDS):
    return [field_of(settings, seed) for seed in range(count)]


@pytest.fixture(scope="module", autouse=True)
def _forgotten_fields():
    """Free the memory of the fields that the tests of this module share."""
    yield
    field_of.cache_clear()


def moments_of(field, lag):
    """Means of the increments' second, third (of the magnitude), fourth and sixth powers."""
    increments = np.abs(field[lag:] - field[:-lag])
    square = increments * increments
    return np.mean(square), np.mean(square * increments), np.mean(square * square), np.mean(square * square * square)


def structure_functions(settings, drawn):
    """Moments 2, 3, 4 and 6 of the increments over all fields, (separations, 4)."""
    lags = np.round(INERTIAL / node_spacing(settings)).astype(int)
    return np.array([np.mean([moments_of(u, lag) for u in drawn], axis=0) for lag in lags])


@pytest.fixture(scope="module")
def statistics():
    """Orders 2, 3, 4 and 6 of both kinds."""
    return {s.kind: structure_functions(s, fields(s)) for s in (CASCADE, GAUSSIAN)}


def relative_exponent(moments, column):
    """Extended self-similarity: slope of the log of a moment on the log of the third one."""
    logs = np.log(moments)
    return np.polyfit(logs[:, 1], logs[:, column], 1)[0]


def flatness_growth(moments):
    """Slope of the log of the flatness on the log of the separation, negative where it grows towards small scales."""
    return np.polyfit(np.log(INERTIAL), np.log(moments[:, 2] / moments[:, 0] ** 2), 1)[0]


def test_she_leveque_exponents():
    """The published values: zeta_3 = 1 exactly, zeta_2 = 0.696, zeta_6 = 1.778."""
    assert she_leveque(3.0) == pytest.approx(1.0)
    assert she_leveque(2.0) == pytest.approx(0.696, abs=5e-4)
    assert she_leveque(6.0) == pytest.approx(1.778, abs=5e-4)
    assert spectral_slope(CASCADE) == spectral_slope(GAUSSIAN) == 1.0 + she_leveque(2.0)


def test_cascade_has_the_exponents_asked_for(statistics):
    """ESS of 40 fields of 2 km, 1 to 16 m: 1.778 within three times the sampling error of 0.013, not the Gaussian 2."""
    assert relative_exponent(statistics["cascade"], 3) == pytest.approx(1.778, abs=0.04)
    assert relative_exponent(statistics["cascade"], 0) == pytest.approx(0.696, abs=0.01)


def test_gaussian_twin_has_those_of_a_gaussian(statistics):
    assert relative_exponent(statistics["gaussian"], 3) == pytest.approx(2.0, abs=0.03)
    assert relative_exponent(statistics["gaussian"], 0) == pytest.approx(2.0 / 3.0, abs=0.01)


def test_flatness_grows_in_the_cascade_alone(statistics):
    """F(r) goes with r to the power zeta_4 - 2 zeta_2 = -0.11; the twin stays at three at every scale."""
    expected = she_leveque(4.0) - 2.0 * she_leveque(2.0)
    assert expected == pytest.approx(-0.112, abs=1e-3)
    assert flatness_growth(statistics["cascade"]) == pytest.approx(expected, abs=0.03)
    assert abs(flatness_growth(statistics["gaussian"])) < 0.02
    moments = statistics["gaussian"]
    np.testing.assert_allclose(moments[:, 2] / moments[:, 0] ** 2, 3.0, atol=0.2)


def test_twin_has_the_same_spectrum(statistics):
    """Second moments, which are the spectrum's transform, agree at every separation."""
    np.testing.assert_allclose(statistics["cascade"][:, 0], statistics["gaussian"][:, 0], rtol=0.2)


@pytest.mark.parametrize(("settings", "slope"), [(CASCADE, 1.696), (GAUSSIAN, 1.696), (None, 2.2)])
def test_spectrum_has_its_slope(settings, slope):
    settings = settings or CASCADE.model_copy(update={"slope": 2.2})
    assert spectral_slope(settings) == pytest.approx(slope, abs=1e-3)
    spectra = [welch(u, 1.0 / node_spacing(settings), nperseg=32768) for u in fields(settings, 20)]
    wavenumber, density = spectra[0][0], np.mean([s[1] for s in spectra], axis=0)
    fitted = (wavenumber > 1.0 / 64.0) & (wavenumber < 1.0)
    # Even weight an octave, so that the many small scales do not decide alone.
    octaves = np.round(3.0 * np.log2(wavenumber[fitted]))
    points = [
        (np.log(wavenumber[fitted][octaves == o]).mean(), np.log(density[fitted][octaves == o]).mean())
        for o in np.unique(octaves)
    ]
    assert -np.polyfit(*np.transpose(points), 1)[0] == pytest.approx(slope, abs=0.07)


@pytest.mark.parametrize("settings", [CASCADE, GAUSSIAN])
def test_fields_have_their_strength(settings):
    drawn = fields(settings)
    assert np.sqrt(np.mean(np.square(drawn))) == pytest.approx(settings.rms, rel=0.06)
    assert abs(np.mean(drawn)) < 0.2 * settings.rms
    assert len(drawn[0]) * node_spacing(settings) >= LENGTH


def test_slopes_belong_to_the_values():
    values = gust_field(CASCADE, 100.0, np.random.default_rng(0))
    table = with_slopes(values, node_spacing(CASCADE))
    np.testing.assert_array_equal(table[:, 0], values)
    np.testing.assert_allclose(table[1:-1, 1], (values[2:] - values[:-2]) / (2.0 * node_spacing(CASCADE)))
