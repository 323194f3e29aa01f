"""Drag over lift by the response of the depth rate to the pitch."""

import numpy as np
import pytest
from support.glides import DRAG, INDUCED, angle_of_attack

from gliderhpc.tuning.glide_polar import GlideSegments, fit_polar, prior_polar


def _segments(drag, pitches, noise, seed=0):
    """Segments of dives whose pilots change the pitch, with the depth rates of the steady balance."""
    rng = np.random.default_rng(seed)
    rows = []
    for phase in range(12):
        buoyancy = rng.uniform(1.5, 3.0)
        for place, pitch in enumerate(rng.permutation(np.repeat(pitches, 4))):
            theta = -np.radians(pitch)
            alpha = angle_of_attack(theta, drag)
            path = theta - alpha
            speed = np.sqrt(buoyancy * np.sin(-path) / (drag * (DRAG + INDUCED * alpha**2)))
            rate = speed * np.sin(-path) * (1.0 - 1e-4 * place) * np.exp(noise * rng.standard_normal())
            rows.append((2 * phase, 10.0 * place, theta, rate))
    phase, depth, pitch, rate = np.array(rows).T
    return GlideSegments(phase.astype(np.int64), depth, pitch, rate)


@pytest.mark.parametrize("drag", [0.6, 1.0, 1.5])
def test_drag_is_found_where_the_pilot_changes_the_pitch(drag):
    prior = prior_polar("slocum")
    found = fit_polar(prior, _segments(drag, (20.0, 24.0, 29.0, 35.0), 0.01))
    assert found.deviation < 0.7 * prior.deviation
    assert np.log(found.scaled) == pytest.approx(np.log(drag), abs=2.0 * found.deviation)
    assert abs(np.log(found.scaled / drag)) < abs(np.log(drag)) * 0.6 + 0.05


def test_an_even_pitch_leaves_the_prior():
    prior = prior_polar("slocum")
    found = fit_polar(prior, _segments(1.5, (25.6, 26.0, 26.4), 0.05))
    assert found.deviation > 0.9 * prior.deviation
    assert abs(np.log(found.scaled)) < 0.3 * prior.deviation


def test_few_dives_leave_the_prior_as_it_is():
    prior = prior_polar("seaglider")
    empty = GlideSegments(np.zeros(0, np.int64), np.zeros(0), np.zeros(0), np.zeros(0))
    assert fit_polar(prior, empty) is prior


@pytest.mark.parametrize(
    ("text", "make"),
    [
        ("Teledyne Webb Slocum G3", "slocum"), ("ru29-20150623", "slocum"), ("SG249", "seaglider"),
        ("dfo-eva035 SeaExplorer", "seaexplorer"), ("Petrel-L", "petrel-l"),
    ],
)  # fmt: skip
def test_the_make_is_read_from_what_a_file_says(text, make):
    assert prior_polar(text).make == make


def test_an_unknown_make_has_a_wider_prior():
    assert prior_polar("a new glider").deviation > prior_polar("slocum").deviation
