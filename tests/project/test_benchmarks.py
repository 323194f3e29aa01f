"""Arithmetic of the benchmarks, and verification that every timed contender solves the stated problem."""

import math
import os

import numpy as np
import psutil
import pytest
import xarray as xr
from llvmlite import binding

from benchmarks import fortran, front_picture, next_surfacing, peers, watch_growth
from benchmarks.engines import ENGINES, Engine
from benchmarks.measure import gradient_rows, profile_rows, window_rows, worth
from benchmarks.memory import PeakMemory, watched_memory
from benchmarks.mission import core_hours, folder_bytes, run_and_measure
from benchmarks.operations import Counted, count_of, operations_a_step
from benchmarks.peak import count_vector_fma, vector_instructions
from benchmarks.peers.base import Answer, UnavailableError, judge, one_at_a_time, require, verify
from benchmarks.peers.model import Functions, rates, rk4
from benchmarks.peers.quasi_newton import minimise, options_of
from benchmarks.readme import README, SECTION, performance_section
from benchmarks.results import RESULTS, read_results, write_results
from benchmarks.scaling import worker_counts
from benchmarks.sections import section_of, with_section
from benchmarks.smoother import smoother_rows
from benchmarks.timing import groups_of, growth_exponent, in_turns, one_core, ratios_to, spread_of
from benchmarks.windows import PLATFORM, settings_of, twin_series, twin_windows
from gliderhpc import Glider, load_platform
from gliderhpc.estimation.currents import local_displacement
from gliderhpc.estimation.engines import WindowProblem
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.profile import estimate_profile
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels.parameters import Body
from gliderhpc.outcomes import Outcome

PAPER = settings_of("paper")
PLAIN = Functions(math.sin, math.cos, math.atan2, math.sqrt)


@pytest.fixture(scope="module")
def series():
    return twin_series(PAPER, depth=25.0)


@pytest.fixture(scope="module")
def windows(series):
    return twin_windows(series, PAPER, 3)


def test_median_and_quartiles():
    spread = spread_of([4.0, 1.0, 3.0, 2.0, 5.0])
    assert (spread.median, spread.lower, spread.upper, spread.count) == (3.0, 2.0, 4.0, 5)
    with pytest.raises(ValueError, match="no value"):
        spread_of([])


def test_everyone_takes_a_turn():
    calls = []
    times = in_turns({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, 3)
    assert calls == ["a", "b"] * 4, "one call each goes before those that count"
    assert {name: len(seconds) for name, seconds in times.items()} == {"a": 3, "b": 3}


def test_ratios_and_growth():
    assert ratios_to("a", {"a": 2.0, "b": 5.0}) == {"a": 1.0, "b": 2.5}
    assert growth_exponent([1.0, 2.0, 4.0], [3.0, 6.0, 12.0]) == pytest.approx(1.0)
    assert growth_exponent([1.0, 2.0, 4.0], [1.0, 4.0, 16.0]) == pytest.approx(2.0)
    with pytest.raises(ValueError, match="two sizes"):
        growth_exponent([2.0, 2.0], [1.0, 1.0])


def test_groups_and_counts():
    assert [list(group) for group in groups_of(5, 2)] == [[0, 1], [2, 3], [4]]
    assert [worker_counts(most) for most in (1, 2, 6, 8)] == [[1], [1, 2], [1, 2, 4, 6], [1, 2, 4, 8]]
    assert core_hours(1800.0, 2) == 1.0
    assert core_hours(1800.0, 0) == 0.5, "this process alone is one core"


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system cannot pin a process")
def test_one_core_is_given_back():
    process = psutil.Process()
    before = process.cpu_affinity()
    with one_core():
        assert len(process.cpu_affinity()) == 1
    assert process.cpu_affinity() == before


def test_vector_instructions_are_distinguished_from_scalar_ones():
    text = """
    vfmadd213sd %xmm1, %xmm2, %xmm3
    vfmadd213pd %ymm1, %ymm2, %ymm3
    vfnmadd231pd (%rax), %zmm4, %zmm5
    vmulpd %zmm1, %zmm2, %zmm3
    fmla v0.2d, v1.2d, v2.2d
    fmla d0, d1, v2.d[0]
    """
    assert count_vector_fma(text) == {"ymm": 1, "zmm": 1, "v": 1}


@pytest.mark.compiled
@pytest.mark.skipif(not binding.get_host_cpu_features().get("fma"), reason="this CPU has no fused multiply-add")
def test_the_peak_is_measured_on_vectors():
    assert sum(vector_instructions().values()) >= 64


def test_operations_are_counted():
    a, b = Counted(2.0), Counted(3.0)
    assert count_of(lambda: 1.0 - a * b + 2.0 / b) == 4
    assert count_of(lambda: (-abs(a), a < b, a == 2.0)) == 0
    assert float(a**2 - b) == 1.0


def test_a_step_takes_thousands_of_operations():
    """Eight right-hand sides or their transposes of 200 to 1,000 operations each."""
    assert 1600 < operations_a_step() < 8000


def test_the_peers_equations_are_the_projects():
    glider = Glider(load_platform(PLATFORM))
    rng = np.random.default_rng(3)
    for _ in range(20):
        state = np.zeros(12)
        state[SENSED] = rng.uniform(-0.5, 0.5, 10)
        state[[5, 6]] += 50.0, 0.8
        control, b = [0.01, 0.3, -0.1, 0.2], rng.normal(size=6)
        body = Body(*glider.bodies(np.array([control]))[0])
        ours = rates(PLAIN, glider.hull, body, state[SENSED], b)
        np.testing.assert_allclose(ours, glider.rhs(state, control, b)[SENSED], rtol=1e-11, atol=1e-13)
        stepped = rk4(PLAIN, glider.hull, body, state[SENSED], b, 0.1)
        expected = glider.simulate(state, [control], b[None], 0.1)[1][SENSED]
        np.testing.assert_allclose(stepped, expected, rtol=1e-11, atol=1e-13)


@pytest.mark.long
@pytest.mark.compiled
@pytest.mark.parametrize("name", ENGINES)
def test_windows_are_the_pipelines(series, windows, name):
    """The timed problems are those that `windows` posed: the pipeline by the same engine ends each at the same bits."""
    settings = PAPER.model_copy(update={"engine": name})
    records = estimate_profile(prepare_profile(Glider(load_platform(PLATFORM)), series), settings).solution.windows
    if name != PAPER.engine:
        windows = twin_windows(series, settings, len(windows))
    engine = ENGINES[name](settings).contender
    for window, answer, record in zip(windows, engine.solve(windows), records, strict=False):
        verdict = judge(window, answer, PAPER)
        assert (answer.iterations, verdict.outcome) == (record.iterations, record.outcome)
        # The judge's kernels are Numba's; Fortran's are the same to rounding.
        assert verdict.cost == (pytest.approx(record.cost, rel=1e-12) if name == "fortran" else record.cost)


def two_engines(mission, gradient):
    """Results of the comparison of Numba's and Fortran's lanes, Fortran so many times as fast."""

    def rows(key, gain, **more):
        return {"lanes": {key: gain, **more}, "fortran": {key: 1.0, **more}}

    return {
        "machine": {"day": "2026-01-01", "cpu": "a processor", "numba": "0.6", "load": 0.0}, "lanes": 8,
        "compiler": "GCC", "flags": "-O3", "gradient": rows("median", gradient), "window": rows("mean", 1.1),
        "profile": rows("median", 1.1), "profile_minutes": 42.0, "mission": rows("median", mission, profiles=24),
        "cold_start": {"first windows": {"lanes": {"cold": 30.0, "warm": 2.0}, "fortran": {"cold": 15.0, "warm": 2.0}}},
        "build_seconds": 20.0,
    }  # fmt: skip


def test_the_page_of_the_fortran_kernels_names_the_faster():
    text = fortran.section(two_engines(mission=1.1, gradient=1.25))
    assert "Fortran is the faster of the two for cost and gradient, 1.25 times Numba's speed" in text
    assert "gains a factor of 1.10, below the 1.3 required to change the default, which remains `lanes`" in text
    assert "| first windows of a process, cache empty, s | 30 | 15 | 2.00 |" in text
    assert "Numba is the faster of the two" in fortran.section(two_engines(mission=1.1, gradient=0.8))
    assert "above 1.3: the default should change" in fortran.section(two_engines(mission=1.4, gradient=1.5))


def test_the_page_of_the_fortran_kernels_is_of_the_results():
    """The page shows the results."""
    found = read_results(RESULTS)
    if "fortran" not in found:
        pytest.skip("not measured yet: python -m benchmarks.fortran")
    assert section_of(fortran.PAGE.read_text("utf-8"), fortran.SECTION) == fortran.section(found["fortran"])


@pytest.mark.compiled
@pytest.mark.parametrize("name", peers.PEERS)
def test_a_peer_solves_the_same_problem(name, windows):
    try:
        peer = peers.PEERS[name](PAPER)
    except UnavailableError as lack:
        pytest.skip(f"{name}: {lack}")
    assert verify(peer, windows) < 1e-9
    for window, answer in zip(windows, peer.solve(windows), strict=True):
        assert judge(window, answer, PAPER).outcome is Outcome.CONVERGED


@pytest.mark.compiled
def test_scipy_about_a_peer_is_the_scipy_engine(windows):
    window = windows[0]
    problem = WindowProblem(window.data)
    ours = minimise(problem.evaluate, window, options_of(PAPER, window.data.step))
    (engine,) = ENGINES["scipy"](PAPER).contender.solve([window])
    np.testing.assert_array_equal(ours.x, engine.x)
    assert ours.iterations == engine.iterations


def _contender(evaluator, name="other"):
    return one_at_a_time(name, name, evaluator, lambda window: Answer(window.unknown, 0, 1), {}, {})


@pytest.mark.compiled
@pytest.mark.parametrize("factor", [1.0 + 1e-8, math.nan])
def test_another_problem_is_not_timed(windows, factor):
    def evaluator(window):
        problem = WindowProblem(window.data)

        def evaluate(x):
            cost, gradient = problem.evaluate(x)
            return cost, gradient * factor

        return evaluate

    with pytest.raises(ValueError, match="other differs from the project's cost and gradient"):
        verify(_contender(evaluator), windows)


@pytest.mark.compiled
def test_answers_are_judged_by_the_projects_measure(windows):
    window = windows[0]
    start = window.unknown
    assert judge(window, Answer(start, 5, 6), PAPER).outcome is Outcome.STALLED
    assert judge(window, Answer(start, 200, 210), PAPER).outcome is Outcome.ITERATION_LIMIT
    assert judge(window, Answer(start * math.nan, 5, 6), PAPER).outcome is Outcome.DIVERGED
    figures = worth([window] * 2, [Answer(start, 5, 6), Answer(start, 200, 210)], PAPER)
    assert figures["outcomes"] == {"stalled": 1, "iteration_limit": 1}
    assert figures["iterations"] == 102.5


@pytest.mark.compiled
def test_time_is_shared_among_a_batch(windows):
    """Rows of an engine that takes two windows at a time, and of one that takes one."""
    taken = []

    def solve(chosen):
        taken.append(len(chosen))
        return [Answer(window.unknown, 0, 1) for window in chosen]

    single = ENGINES["scipy"](PAPER).contender
    pair = type(single)("pair", "pair", single.prepare, solve, batch=2)
    rows = window_rows([single, pair], windows, PAPER, 2, "scipy")
    assert taken == [2, 1, 2, 2, 1, 1], "a pass that does not count, then each stretch twice"
    assert rows["scipy"]["ratio"] == 1.0
    assert rows["pair"]["count"] == 3
    assert set(gradient_rows([single, pair], windows, 2, "scipy")) == {"scipy", "pair"}


def test_a_profiles_time_is_shared_among_those_taken_at_a_time(series):
    taken = []
    engine = Engine(
        ENGINES["scipy"](PAPER).contender, lambda glider, profiles: taken.append(len(profiles)), at_a_time=4
    )
    assert profile_rows({"four": engine}, Glider(load_platform(PLATFORM)), series, 3)["four"]["count"] == 3
    assert taken == [4] * 4


@pytest.mark.long
def test_the_peers_of_the_smoother_have_the_same_answer():
    """Rauch, Tung and Striebel with whole matrices, over the same segments; dynamax adds 1e-9 to what it inverts."""
    row = smoother_rows(settings_of("recommended"), 15.0, 1)
    assert row["largest_differences"]["dense"] < 1e-4
    assert row["largest_differences"].get("dynamax", 0.0) < 1e-4
    assert {*row["ratios"], *row["skipped"]} == {"dense", "dynamax"}
    assert row["pass_us"] > 0.0
    assert row["ratios"]["dense"] == pytest.approx(row["dense_us"]["median"] / row["pass_us"])


def test_a_missing_package_is_one_line():
    with pytest.raises(UnavailableError, match=r"no_such_package is not installed; pip install 'gliderhpc\[bench\]'"):
        require("no_such_package")


def test_peers_that_lack_something_are_named(monkeypatch):
    def lacking(_):
        raise UnavailableError("no compiler")

    found = _contender(lambda window: WindowProblem(window.data).evaluate)
    monkeypatch.setattr(peers, "PEERS", {"other": lambda _: found, "lacking": lacking})
    assert peers.available_peers(PAPER) == ([found], {"lacking": "no compiler"})


def test_memory_of_workers():
    class Process:
        def __init__(self, size, *children):
            self.size, self.below = size, list(children)

        def memory_info(self):
            if self.size is None:
                raise psutil.NoSuchProcess(1)
            return type("Memory", (), {"rss": self.size})

        def children(self, recursive):
            assert recursive
            return self.below

    peak = PeakMemory()
    peak.sample(Process(10))
    assert peak.of_a_worker == 10, "no worker: this process did the work"
    peak.sample(Process(9, Process(7), Process(None)))
    peak.sample(Process(12, Process(5)))
    assert (peak.parent, peak.of_a_worker) == (12, 7)


def test_this_process_is_watched():
    with watched_memory() as peak:
        peak.sample(psutil.Process())
    assert peak.parent > 2**20


@pytest.mark.long
@pytest.mark.compiled
def test_a_missions_row(brief, tmp_path):
    row = run_and_measure(brief, tmp_path / "m.zarr", "petrel-l", "scipy", "recommended", 0)
    assert (row["profiles"], row["failed"]) == (3, 0)
    assert row["record_hours"] == pytest.approx(0.45, abs=0.15)
    assert row["peak_worker_mib"] > 50.0
    assert row["archive_mib"] == pytest.approx(folder_bytes(tmp_path / "m.zarr") / 2**20)


def test_a_mission_that_cannot_run_says_why(tmp_path):
    with pytest.raises(RuntimeError, match=r"nothing\.nc"):
        run_and_measure(tmp_path / "nothing.nc", tmp_path / "m.zarr", "petrel-l", "scipy", "recommended", 0)


def test_results_survive_the_file(tmp_path):
    path = tmp_path / "r.json"
    assert read_results(path) == {}
    write_results(path, {"a": {"b": 0.1}})
    assert read_results(path) == {"a": {"b": 0.1}}


def test_the_readme_says_what_was_measured():
    assert section_of(README.read_text("utf-8"), SECTION) == performance_section(read_results(RESULTS))


def test_the_readmes_picture_is_small():
    """Drawn by `benchmarks.front_picture`; every reader of the README loads it."""
    assert 20_000 < front_picture.PICTURE.stat().st_size < 200_000
    assert "docs/assets/mission.png" in README.read_text("utf-8")
    section = section_of(README.read_text("utf-8"), front_picture.SECTION)
    assert "the `drift` study detected" in " ".join(section.split())


@pytest.fixture
def pictured():
    """A synthetic archive: three profiles, the last without a current, and an episode on the second."""
    profile = {"profile": [1, 2, 3]}
    table = xr.Dataset(
        {
            name: ("profile", np.asarray(values, float))
            for name, values in {
                "elapsed_days": [0.0, 1.0, 2.0],
                "entry_latitude": [27.0, 27.1, np.nan], "exit_latitude": [27.1, 27.2, np.nan],
                "entry_longitude": [-90.0, -90.1, np.nan], "exit_longitude": [-90.1, -90.1, np.nan],
                "dac_north_smoothed": [0.1, 0.2, np.nan], "dac_east_smoothed": [0.0, -0.1, np.nan],
                "dac_north_smoothed_std": [0.01, 0.02, np.nan], "dac_east_smoothed_std": [0.02, 0.01, np.nan],
                "dac_smoothed_covariance": [0.0, 0.0001, np.nan],
            }.items()
        },
        coords=profile, attrs={"platform": {"viscous": {"K_D0": 4.0}}},
    )  # fmt: skip
    drift = xr.Dataset(
        {f"K_D0_{phase}_smoothed": ("profile", [0.0, 2.0, 0.1]) for phase in ("dive", "climb")}
        | {"first_day": ("change", [1.0]), "last_day": ("change", [1.0]), "change_kind": ("change", ["episode"])}
        | {"change_phases": ("change", ["climb"])}
        | {f"K_D0_change_{phase}_adjoint": ("change", [value]) for phase, value in (("dive", 0.1), ("climb", 2.0))},
        coords=profile,
    )
    return xr.DataTree.from_dict({"/": table, "drift": drift})


def test_the_caption_is_of_the_archive(pictured):
    text = " ".join(front_picture.caption(pictured).split())
    assert "currents of 2 dives, 0.10 to 0.22 m/s, with a median standard deviation of 0.015 m/s" in text
    assert "study detected this episode automatically: on climbs the drag rose by up to 50%" in text


def test_the_picture_shows_currents_ellipses_and_changes(pictured):
    chart, over_time, drag = front_picture.front_picture(pictured).axes
    assert len(chart.patches) == 2, "an ellipse a current"
    np.testing.assert_allclose(chart.patches[0].width, 2.0 * chart.patches[0].height)
    assert chart.patches[0].angle % 180.0 == pytest.approx(0.0), "the larger deviation is to the east"
    assert len(over_time.containers) == 2
    assert [text.get_text() for text in drag.get_legend().get_texts()] == ["dive", "climb", "episode found"]


def test_a_section_replaces_the_old_one():
    text = "before\n<!-- performance -->\nold\n<!-- /performance -->\nafter\n"
    once = with_section(text, "performance", "new")
    assert once == "before\n<!-- performance -->\nnew\n<!-- /performance -->\nafter\n"
    assert with_section(once, "performance", "new") == once
    with pytest.raises(ValueError, match="<!-- performance -->"):
        with_section("no marks", "performance", "new")


@pytest.mark.parametrize(("load", "busy"), [(0.4, False), (5.0, True)])
def test_the_performance_section_mentions_a_busy_machine(load, busy):
    results = read_results(RESULTS)
    results["machine"]["load"] = load
    assert ("busy with other work" in performance_section(results)) == busy


def test_a_mission_has_a_row_in_the_readme():
    row = {
        "profiles": 565, "record_hours": 1700.0, "preset": "paper", "engine": "scipy", "wall_seconds": 1800.0,
        "workers": 2, "core_hours": 1.0, "peak_worker_mib": 512.0, "archive_mib": 2048.0, "failed": 3,
        "machine": {"cpu": "A", "cores": 16},
    }  # fmt: skip
    text = performance_section({**read_results(RESULTS), "missions": {"mission": row}})
    cells = "`paper`, engine scipy | 30.0 | 2 | 1.00 | 512 | 2048 | 3 | A, 16 cores |"
    assert f"| 565 profiles, 1700 h of record, {cells}" in text


def test_predicted_surfacings_are_scored_against_a_glider_that_goes_elsewhere():
    flown = next_surfacing.mission(1, 5)
    found, distances = next_surfacing.misses(flown, 4)
    # Without the current the miss is that of the water's displacement, fixes and the dive's own differences.
    last = flown.table.isel(profile=-2)
    own = np.array([float(last["displacement_north"]), float(last["displacement_east"])])
    way = local_displacement(flown.fix(3), flown.fix(4))
    assert found["no current"] == pytest.approx(float(np.linalg.norm(way - own)))
    assert min(distances.values()) > 0.0
    rows = list(next_surfacing.rows_of(1))
    assert [row["dives so far"] for row in rows] == 2 * [*map(str, next_surfacing.AFTER), "all"]


@pytest.mark.long
@pytest.mark.compiled
def test_the_dives_of_a_watch_are_timed_after_those_before(tmp_path, monkeypatch):
    monkeypatch.setattr(watch_growth, "TIMED", 1)
    rows = list(watch_growth.rows_of((1, 3), tmp_path))
    assert [row["dives before"] for row in rows] == [1, 3]
    # Only the dives that are timed have a message.
    assert len(list((tmp_path / "watch").glob("dive-*.json"))) == 2
