"""Vectorised loops over lanes: their machine code uses whole registers, on this processor and on narrower ones.

A silent fallback to scalar code would pass every other test and be eight times as slow.
"""

import json
import os
import subprocess
import sys

import llvmlite.binding
import numba
import numpy as np
import pytest
from support.lane_results import results
from support.machine_code import arithmetic
from support.repository import REPOSITORY

from gliderhpc.kernels.elementwise import LANES, load, store

FEATURES = llvmlite.binding.get_host_cpu_features()
pytestmark = [
    pytest.mark.compiled,
    pytest.mark.skipif(
        not (FEATURES.get("avx2") and FEATURES.get("fma")), reason="this processor has no vectors of four doubles"
    ),
]

NARROWER = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx,+avx2,+fma,+bmi,+bmi2,+sse4.2"}
LEAST = {"forward": 600, "adjoint": 1000, "multiply_pairs": 10, "point_directions": 10, "measure_trial": 10,
         "accept_trial": 5, "place_trial": 2}  # fmt: skip
"""Least number of operations in each kernel."""


@pytest.fixture(scope="module")
def here():
    return results()


@pytest.fixture(scope="module")
def narrower():
    """Return the same for this processor without AVX-512."""
    done = subprocess.run(
        [sys.executable, "-m", "support.lane_results"],
        env={**os.environ, **NARROWER, "PYTHONPATH": f"{REPOSITORY}{os.pathsep}{REPOSITORY / 'tests'}"},
        capture_output=True, text=True, timeout=300, check=True,
    )  # fmt: skip
    answer = json.loads(done.stdout)
    for counts in answer["arithmetic"].values():
        for width in list(counts):
            counts[int(width)] = counts.pop(width)
    return answer


def assert_vectorised(found, lanes):
    """Assert that only whole registers are used, except for a few scalars outside the loops."""
    assert set(found) == set(LEAST)
    for name, counts in found.items():
        whole, rest = counts.get(lanes, 0), sum(counts.values()) - counts.get(lanes, 0)
        assert whole >= LEAST[name], (name, counts)
        assert rest <= 0.01 * whole, (name, counts)


def test_lanes_fill_this_processors_registers(here):
    assert here["lanes"] == LANES == (8 if FEATURES.get("avx512f") else 4)
    assert_vectorised(here["arithmetic"], LANES)


def test_lanes_fill_the_registers_of_a_narrower_processor(narrower):
    assert narrower["lanes"] == 4
    assert_vectorised(narrower["arithmetic"], 4)


def test_a_narrower_processor_gives_the_same_results(here, narrower):
    """The results agree up to rounding, since operations may be fused differently."""
    for name in ("iterations", "evaluations"):
        assert narrower[name] == here[name] > 0
    assert narrower["cost"] == pytest.approx(here["cost"], rel=1e-9)
    np.testing.assert_allclose(narrower["states"], here["states"], rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(narrower["disturbances"], here["disturbances"], rtol=1e-6, atol=1e-9)


def test_the_operation_count_distinguishes_scalars_from_vectors():
    """A recurrence without lanes cannot be vectorised, and its operations are counted as scalar."""

    @numba.njit(error_model="numpy")
    def summed(x, out):
        total = load(x, 0)
        for i in range(1, x.shape[0]):
            total = total * load(x, i) + 1.0
        store(out, 0, total)

    lanes, numbers = np.ones((9, LANES)), np.ones(9)
    found = []
    for x in (lanes, numbers):
        compiled = numba.njit(error_model="numpy")(summed.py_func)
        compiled(x, x.copy())
        found.append(arithmetic(compiled))
    assert set(found[0]) == {LANES}
    assert set(found[1]) == {1}
