"""Rudder: a known control with a yaw moment ``K_delta delta V^2`` in the flow's frame (docs/how-to/platform.md).

Derivatives by the state with a moving rudder are compared with the complex step in test_dynamics.py (Jacobian) and
test_adjoint.py (gradient over a window), and lanes with scalar kernels in test_lane_window.py.
"""

import numpy as np
import pytest
from support.missions import program
from support.specimens import lopsided_platform, random_controls, random_disturbances, random_state

from gliderhpc import open_mission
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import steady_glide
from gliderhpc.observations import write_observations
from gliderhpc.platform import read_platform, shipped_platforms, with_overrides

STEP = 0.1
CALM = np.zeros(6)


def answers(glider, controls):
    """Return rates, Jacobian, cost and gradient of a flight under the controls ``(n, 5)``."""
    rng = np.random.default_rng(1)
    state = random_state(rng)
    disturbances = random_disturbances(rng, len(controls))
    cost, gradient = glider.tracking_cost(state, controls, disturbances, np.zeros((len(controls) + 1, 4)), STEP)
    return glider.rhs(state, controls[0], CALM), glider.jacobian(state, controls[0]), cost, gradient


def test_without_its_coefficient_or_amidships_the_rudder_changes_no_bit():
    controls = random_controls(np.random.default_rng(0), 20)
    amidships = controls * [1.0, 1.0, 1.0, 1.0, 0.0]
    without, given = (Glider(lopsided_platform(K_delta=value)) for value in (0.0, 12.0))
    expected = answers(without, amidships)
    for glider, flown in ((without, controls), (given, amidships)):
        for ours, theirs in zip(answers(glider, flown), expected, strict=True):
            np.testing.assert_array_equal(ours, theirs)
    assert np.abs(answers(given, controls)[3] - expected[3]).max() > 0.0


def test_the_moment_is_its_formula():
    """On a hull in straight, level flow the rudder's moment is ``K_delta delta V^2``, about z only."""
    platform = with_overrides(read_platform("slocum"), {"viscous.K_delta": "7.0"})
    glider = Glider(platform)
    state = np.zeros(12)
    state[6] = 0.4
    put = glider.rhs(state, [0.0, 0.0, 0.0, 0.0, 0.2], CALM) - glider.rhs(state, np.zeros(4), CALM)
    assert put[11] / glider.input_diagonal()[5] == pytest.approx(7.0 * 0.2 * 0.4**2, rel=1e-12)
    np.testing.assert_array_equal(put[:11], 0.0)


@pytest.mark.parametrize("name", shipped_platforms())
@pytest.mark.parametrize(("drive", "pitch"), [(0.25, -25.0), (-0.25, 25.0)], ids=["dive", "climb"])
def test_a_positive_rudder_turns_every_hull_to_starboard(name, drive, pitch):
    """For positive K_delta the heading increases, on dive and climb; a negative rudder turns as fast to port."""
    glider = Glider(with_overrides(read_platform(name), {"viscous.K_delta": "10.0"}))
    glide = steady_glide(glider, drive, np.radians(pitch), 100.0)
    rates = []
    for rudder in (0.1, -0.1):
        controls = np.tile([*glide.control[:4], rudder], (3000, 1))
        state = glider.simulate(glide.state, controls, np.zeros((3000, 6)), STEP)[-1]
        rates.append(glider.rhs(state, controls[0], CALM)[2])
    assert np.degrees(rates[0]) > 0.05
    assert rates[1] == pytest.approx(-rates[0], rel=1e-9)


# From the file to the disturbance ------------------------------------------------------------------------------------

K_DELTA, RUDDER = 4.0, 12.0
"""Coefficient of the hull (kg/rad), and angle of the rudder in the second half of the flight (degree)."""


@pytest.fixture(scope="module")
def turning(tmp_path_factory):
    """Simulate a slow dive in still water, straight and then with the rudder over: records with and without it."""
    folder = tmp_path_factory.mktemp("rudder")
    platform = with_overrides(read_platform("petrel-l"), {"viscous.K_delta": str(K_DELTA)})
    glide = steady_glide(Glider(platform), 0.4, np.radians(-23.0), 50.0)
    n = 6000
    rudder = np.where(np.arange(n) < n // 2, 0.0, RUDDER)
    # The glide is defined by the oil's masses; the file contains the corresponding volume.
    volume = glide.control[2] / (platform.buoyancy.oil_density - platform.buoyancy.water_density)
    controls = np.column_stack([np.tile(glide.control[:4], (n, 1)), np.radians(rudder)])
    states = Glider(platform).simulate(glide.state, controls, np.zeros((n, 6)), STEP)[:-1:10]
    angles = np.degrees(states[:, :3])
    variables = {
        "time": np.datetime64("2024-01-01T00:00:00") + np.arange(len(states)) * np.timedelta64(1, "s"),
        "roll": angles[:, 0], "pitch": angles[:, 1], "heading": np.mod(angles[:, 2], 360.0), "depth": states[:, 5],
        "battery_position": np.full(len(states), glide.control[0]), "battery_rotation": np.zeros(len(states)),
        "ballast_volume": np.full(len(states), 1e6 * volume), "rudder": rudder[::10],
        "profile": np.ones(len(states), dtype=np.int64),
    }  # fmt: skip
    attributes = {"platform": "petrel-l", "mission": "turning", "source": "the test"}
    write_observations(variables, folder / "with.nc", attributes=attributes)
    del variables["rudder"]
    write_observations(variables, folder / "without.nc", attributes=attributes)
    return folder, float(np.median(np.linalg.norm(states[:, 6:9], axis=1)))


def yaw_moments(observations, store):
    """Return the inverted yaw moment in each half of the flight, without its ends and the change of rudder (N m)."""
    answer = program(
        "run-mission", observations, "--platform", "petrel-l", "--set", f"platform.viscous.K_delta={K_DELTA}",
        "--store", store, "--workers", 0,
    )  # fmt: skip
    assert answer.status == 0, answer.err
    series = open_mission(store)["series"].ds.sel(profile=1).load()
    moment, half = series["B_cr"].values, 3000
    return np.nanmedian(moment[600 : half - 200]), np.nanmedian(moment[half + 600 : 2 * half - 600])


@pytest.mark.compiled
def test_a_rudder_in_the_record_is_no_disturbance(turning):
    """With the variable `rudder` the yaw moment is zero throughout; without it, it is attributed to the water."""
    folder, speed = turning
    straight, put_over = yaw_moments(folder / "with.nc", folder / "with.zarr")
    moment = K_DELTA * np.radians(RUDDER) * speed**2
    assert abs(straight) < 0.05 * moment
    assert abs(put_over) < 0.05 * moment
    straight, put_over = yaw_moments(folder / "without.nc", folder / "without.zarr")
    assert abs(straight) < 0.05 * moment
    assert put_over == pytest.approx(moment, rel=0.1)
