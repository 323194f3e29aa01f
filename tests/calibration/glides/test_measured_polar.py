"""Drag and lift from a measured velocity in steady straight glides (docs/measured-velocity.md)."""

from dataclasses import replace

import numpy as np
import pytest
from support.steady_glides import glides

from gliderhpc.calibration.glides.measured_polar import measured_polar, with_measured_polar
from gliderhpc.calibration.glides.segment_errors import SegmentErrors
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import with_deviations_of, with_values
from gliderhpc.flight.steady_glide import glides_stably
from gliderhpc.platform import platform_yaml, read_platform
from gliderhpc.platform_sections import Uncertainty

PETREL = read_platform("petrel-l")
TRUTH = with_values(PETREL, {"viscous.K_D0": 11.0, "viscous.K_L": 390.0})


def segments(truth=TRUTH, offset=(0.0, 0.0, 0.0), profiles=4):
    """Exact glides of a hull with their velocity as measured, with a constant error (m/s)."""
    exact = glides(truth, PETREL, profiles=profiles)
    velocity = SegmentErrors(truth, (), exact)._balance(np.zeros(0)).velocity
    return replace(exact, velocity=velocity + np.array(offset))


def test_exact_glides_give_drag_and_lift_to_within_the_error_of_the_scale():
    found = measured_polar(PETREL, segments(), 0.003)
    attack = 0.046
    drag = (11.0 + PETREL.viscous.K_D * attack**2) / (PETREL.viscous.K_D0 + PETREL.viscous.K_D * attack**2)
    assert found.drag == pytest.approx(drag, rel=0.02)
    assert found.lift == pytest.approx(390.0 / PETREL.viscous.K_L, rel=0.01)
    assert 0.01 < found.lift_error < 0.03
    assert found.lift_error < found.drag_error < 0.05


def test_errors_that_dive_and_climb_share_do_not_matter():
    """A constant error of the normal velocity, and a neutral volume that is wrong by 20 cm3."""
    exact, volume = measured_polar(PETREL, segments(), 0.003), PETREL.buoyancy.neutral_volume
    heavy = with_values(PETREL, {"buoyancy.neutral_volume": volume + 20.0})
    found = measured_polar(heavy, segments(offset=(0.0, 0.0, 0.004)), 0.003)
    assert found.drag == pytest.approx(exact.drag, rel=0.01)
    assert found.lift == pytest.approx(exact.lift, rel=0.01)


def test_noise_of_the_samples_does_not_make_the_lift_seem_small():
    """Of single segments it would: their normal velocity is hardly larger than its noise."""
    exact, found = segments(profiles=8), []
    for seed in range(20):
        noise = np.random.default_rng(seed).normal(0.0, 0.005, exact.velocity.shape)
        found.append(measured_polar(PETREL, replace(exact, velocity=exact.velocity + noise), 0.003).lift)
    assert np.mean(found) == pytest.approx(390.0 / PETREL.viscous.K_L, rel=0.02)


def test_the_platform_gets_the_weighted_mean_of_its_own_and_the_measured():
    found = with_measured_polar(PETREL, PETREL, segments(), 0.003)
    assert pytest.approx(11.0, rel=0.04) == found.viscous.K_D0
    assert pytest.approx(390.0, rel=0.02) == found.viscous.K_L
    assert found.viscous.K_D == PETREL.viscous.K_D
    assert found.uncertainty.deviation["viscous.K_L"] < 0.03
    sure = Uncertainty(deviation={"viscous.K_D0": 0.001, "viscous.K_L": 0.001})
    unmoved = with_measured_polar(PETREL.model_copy(update={"uncertainty": sure}), PETREL, segments(), 0.003)
    assert pytest.approx(PETREL.viscous.K_D0, rel=0.001) == unmoved.viscous.K_D0
    assert unmoved.uncertainty.deviation["viscous.K_D0"] <= 0.001


def test_the_plausible_deviations_of_the_file_come_back():
    narrowed = with_measured_polar(PETREL, PETREL, segments(), 0.003)
    assert "deviation" not in platform_yaml(with_deviations_of(PETREL, narrowed))
    stated = PETREL.model_copy(update={"uncertainty": Uncertainty(deviation={"viscous.K_L": 0.2})})
    narrowed = with_measured_polar(stated, PETREL, segments(), 0.003)
    assert with_deviations_of(stated, narrowed).uncertainty.deviation == {"viscous.K_L": 0.2}
    assert with_deviations_of(stated, stated) is stated


def test_held_parameters_stay():
    found = with_measured_polar(PETREL, PETREL, segments(), 0.003, ("viscous.K_L",))
    assert found.viscous.K_L == PETREL.viscous.K_L
    assert "viscous.K_L" not in found.uncertainty.deviation
    assert found.viscous.K_D0 != PETREL.viscous.K_D0


def test_a_hull_without_induced_drag():
    plain = with_values(PETREL, {"viscous.K_D": 0.0})
    found = with_measured_polar(plain, plain, segments(with_values(TRUTH, {"viscous.K_D": 0.0})), 0.003)
    assert pytest.approx(11.0, rel=0.02) == found.viscous.K_D0


@pytest.mark.parametrize("left_out", ["climbs", "profiles", "normal", "all"])
def test_too_few_segments_change_nothing(left_out):
    given, remarks = segments(profiles=2 if left_out == "profiles" else 4), []
    velocity = given.velocity.copy()
    if left_out == "climbs":
        velocity[given.depth_rate < 0.0] = np.nan
    if left_out in ("normal", "all"):
        velocity[:, 2 if left_out == "normal" else slice(None)] = np.nan
    found = with_measured_polar(PETREL, PETREL, replace(given, velocity=velocity), 0.003, report=remarks.append)
    assert found is PETREL
    assert len(remarks) == (left_out != "all")


def test_the_hull_found_still_glides():
    assert glides_stably(Glider(with_measured_polar(PETREL, PETREL, segments(), 0.003)))
