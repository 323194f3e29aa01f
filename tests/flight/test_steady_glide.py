"""Steady glides: balance, stability, and refused hulls."""

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from gliderhpc.cli.platforms import platforms
from gliderhpc.errors import InputError
from gliderhpc.flight.glider import Glider, load_platform
from gliderhpc.flight.steady_glide import (
    glide_table,
    glides_stably,
    growth_rate,
    imbalance,
    imbalance_slope,
    is_stable,
    least_glide_angle,
    munk_moment,
    sign_in_doubt,
    stall_depth,
    steady_angle_of_attack,
    steady_glide,
    yaw_bracket,
)
from gliderhpc.platform import GRAVITY, ballast_masses, read_platform, shipped_platforms, with_overrides

PETREL = (Path(__file__).parents[2] / "gliderhpc" / "platforms" / "petrel-l.yaml").read_text("utf-8")
ACCELERATIONS = slice(6, 12)


@pytest.fixture(scope="module")
def petrel() -> Glider:
    return Glider(read_platform("petrel-l"))


@pytest.mark.parametrize("name", shipped_platforms())
@pytest.mark.parametrize("net_mass", [0.25, -0.4])
@pytest.mark.parametrize("depth", [0.0, 300.0])
def test_nothing_accelerates_in_a_steady_glide(name, net_mass, depth):
    glider = Glider(read_platform(name))
    glide = steady_glide(glider, net_mass, math.copysign(math.radians(27), -net_mass), depth)
    rates = glider.rhs(glide.state, glide.control, np.zeros(6))
    np.testing.assert_allclose(rates[ACCELERATIONS], 0.0, atol=1e-13)
    assert rates[5] == pytest.approx(glide.depth_rate, rel=1e-12)
    assert math.copysign(1.0, glide.depth_rate) == math.copysign(1.0, net_mass)


def test_petrel_speeds_are_those_its_track_implies(petrel):
    """0.3 to 0.4 kg at 22 to 25 degrees give 0.35 to 0.43 m/s (the platform file's own claim)."""
    glides = glide_table(petrel, (0.3, 0.4), (math.radians(22), math.radians(25)))
    speeds = [glide.speed for glide in glides]
    assert len(glides) == 8
    assert min(speeds) == pytest.approx(0.35, abs=0.005)
    assert max(speeds) == pytest.approx(0.43, abs=0.005)
    assert all(is_stable(petrel, glide) for glide in glides)


def test_a_simulation_from_a_steady_glide_remains_steady(petrel):
    glide = steady_glide(petrel, 0.3, math.radians(-25))
    n = 200
    flight = petrel.simulate(glide.state, np.tile(glide.control, (n, 1)), np.zeros((n, 6)), 0.1)
    assert abs(flight[-1, 1] - glide.pitch) < math.radians(0.2)
    assert abs(np.hypot(flight[-1, 6], flight[-1, 8]) - glide.speed) < 0.01


def test_a_stable_glide_is_returned_to():
    glider = Glider(with_overrides(read_platform("petrel-l"), {"buoyancy.depth_slope": "0"}))
    glide = steady_glide(glider, 0.3, math.radians(-25))
    start = glide.state
    start[6] += 0.05
    start[1] += math.radians(5)
    n = 3000
    flight = glider.simulate(start, np.tile(glide.control, (n, 1)), np.zeros((n, 6)), 0.1)
    np.testing.assert_allclose(flight[-1, [0, 1, 6, 7, 8]], glide.state[[0, 1, 6, 7, 8]], atol=1e-5)


def test_imbalance_is_the_horizontal_viscous_force_and_its_slope_the_derivative(petrel):
    """Against the kernels' own forces: the drag and lift of eq. 11, turned by the pitch into the horizontal."""
    control = [0.0, 0.0, *ballast_masses(petrel.platform, petrel.platform.buoyancy.neutral_volume_m3)]
    masses = petrel.platform.mass.total + np.array(petrel.platform.added_mass)
    for pitch, alpha in ((-0.4, 0.03), (0.5, -0.06), (-0.2, 0.1)):
        state = np.zeros(12)
        state[1] = pitch
        state[6], state[8] = 0.5 * math.cos(alpha), 0.5 * math.sin(alpha)
        still = petrel.rhs(np.concatenate([state[:6], np.zeros(6)]), control, np.zeros(6))
        force = masses * (petrel.rhs(state, control, np.zeros(6)) - still)[6:9]
        ahead = force[0] * math.cos(pitch) + force[2] * math.sin(pitch)
        assert -ahead / 0.25 == pytest.approx(float(imbalance(petrel.platform, pitch, alpha)), rel=1e-9)
        near = [float(imbalance(petrel.platform, pitch, alpha + change)) for change in (-1e-5, 1e-5)]
        assert float(imbalance_slope(petrel.platform, pitch, alpha)) == pytest.approx(
            (near[1] - near[0]) / 2e-5, rel=1e-6
        )


def test_least_glide_angle_is_a_limit(petrel):
    """About 15 degrees for petrel-l (docs/theory/currents.md): no flatter path exists, and steeper ones do."""
    least = least_glide_angle(petrel.platform)
    assert math.degrees(least) == pytest.approx(15.0, abs=0.5)
    pitches = np.radians(np.arange(1.0, 60.0, 0.25))
    flown = [glide.glide_angle for glide in glide_table(petrel, (0.3,), pitches)]
    assert min(np.abs(flown)) >= least
    assert min(np.abs(flown)) == pytest.approx(least, abs=math.radians(0.5))


def test_lift_at_zero_angle_of_attack_splits_dive_and_climb():
    platform = read_platform("seawing")
    assert least_glide_angle(platform) > least_glide_angle(platform, heavy=False)
    dive = steady_angle_of_attack(platform, math.radians(-25), heavy=True)
    climb = steady_angle_of_attack(platform, math.radians(25), heavy=False)
    assert dive > -climb > 0.0


def test_impossible_glides_give_none(petrel):
    assert steady_glide(petrel, 0.3, math.radians(25)) is None
    assert steady_glide(petrel, -0.3, math.radians(-25)) is None
    assert steady_glide(petrel, 0.3, math.radians(-5)) is None
    assert steady_glide(petrel, 0.0, math.radians(-25)) is None
    assert steady_glide(petrel, 0.3, math.radians(-25), depth=700.0) is None


def test_stall_depth(petrel):
    """0.38 kg stalls petrel-l at 746 m (docs/theory/model.md)."""
    depth = stall_depth(petrel.platform, 0.38)
    assert depth == pytest.approx(746.0, abs=1.0)
    assert depth * petrel.platform.buoyancy.depth_slope == pytest.approx(0.38 * GRAVITY)
    assert stall_depth(petrel.platform, -0.38) == math.inf
    assert stall_depth(read_platform("seawing"), 0.38) == math.inf


def test_yaw_moments_of_petrel_nearly_cancel(petrel):
    """Bracket of -18 to -22 against a Munk term of -74 (docs/theory/currents.md)."""
    platform = petrel.platform
    assert munk_moment(platform) == pytest.approx(-73.65)
    two_degrees = math.radians(2.0)
    assert yaw_bracket(platform, two_degrees) == pytest.approx(-22.0, abs=0.5)
    assert yaw_bracket(platform, -two_degrees) == pytest.approx(-17.5, abs=0.5)
    assert sign_in_doubt(platform, two_degrees) < 0.01
    assert 0.35 < sign_in_doubt(read_platform("slocum"), two_degrees) < 0.5


def test_hull_with_everything_off_centre_loads(oracle):
    assert load_platform(oracle / "platform.yaml").name == "oracle"


@pytest.mark.parametrize("name", shipped_platforms())
def test_shipped_hulls_load(name):
    assert load_platform(name).name == name


def test_overrides_are_applied_before_the_hull_is_judged():
    assert load_platform("seaexplorer", {"buoyancy.neutral_volume": "-215"}).buoyancy.neutral_volume == -215.0
    with pytest.raises(InputError, match="no stable steady dive and climb"):
        load_platform("petrel-l", {"viscous.K_r": "0"})


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("K_r: -330.0", "K_r: 0.0"),
        ("K_q: -263.0", "K_q: 0.0"),
        ("hull: [-0.02876, 0.0, 0.0218]", "hull: [-0.02876, 0.0, -0.0218]"),
    ],
)
def test_hulls_that_cannot_glide_are_refused(tmp_path, old, new):
    path = tmp_path / "hull.yaml"
    path.write_text(PETREL.replace(old, new), "utf-8")
    assert not glides_stably(Glider(read_platform(path)))
    with pytest.raises(InputError, match=r"hull\.yaml: this hull has no stable steady dive and climb") as caught:
        load_platform(path)
    assert "\n" not in str(caught.value)


def test_growth_rate_ignores_neutral_directions(petrel):
    glide = steady_glide(petrel, 0.35, math.radians(-22))
    assert -0.2 < growth_rate(petrel, glide) < -0.02


def _run(*arguments: str) -> str:
    result = CliRunner(env={"COLUMNS": "160"}).invoke(platforms, arguments)
    assert result.exit_code == 0, result.output
    return result.output


def test_command_lists_hulls():
    output = _run()
    assert all(name in output for name in shipped_platforms())


def test_command_shows_one_hull():
    output = _run("petrel-l", "--net-mass", "0.38", "--pitch", "25")
    for text in ("746 m at +0.38 kg", "15.3 deg", "+0.38", "-25.0", "-73.6", "stable steady dives and climbs"):
        assert text in output
    assert "its sign is too uncertain" in _run("slocum")
    assert "none: these paths are flatter" in _run("petrel-l", "--pitch", "5")


def test_command_shows_an_unstable_hull_and_prints_files(tmp_path):
    path = tmp_path / "hull.yaml"
    path.write_text(_run("petrel-l", "--yaml").replace("K_r: -330.0", "K_r: 0.0"), "utf-8")
    assert "NO: no stable steady dive or climb" in _run(str(path))
