"""Fortran kernels: equal to Numba's up to rounding, refused if incompatible, and usable as an engine."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from support.implementations import implementation_named
from support.machine_code import arithmetic_of
from support.missions import WHOLE, program
from support.sizes import COMPILED, scaled
from support.specimens import lopsided_platform, random_controls, random_disturbances, random_state, relative_error

from gliderhpc.archive.mission import open_mission
from gliderhpc.errors import InputError
from gliderhpc.estimation import engines, fortran_check
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.kernels.fortran import build, library

LOPSIDED = Glider(lopsided_platform())
HULL = np.array(LOPSIDED.hull)
DECAY = np.exp(-0.1 / np.array([600.0, 60.0, 600.0, 60.0, 600.0, 20.0]))
H = 0.1
COUNT = scaled(50, 5)

compiled = pytest.mark.skipif(not COMPILED, reason="nothing is compiled: a mission would take hours")
compiler = pytest.mark.skipif(shutil.which("gfortran") is None, reason="no gfortran here")


@pytest.fixture(scope="module")
def cases():
    """Draw mass properties, state, disturbance and costate: lopsided hulls, headings of several turns, sternway."""
    rng = np.random.default_rng(0)
    return [
        (
            LOPSIDED.bodies(random_controls(rng, 1)), random_state(rng), random_disturbances(rng, 1)[0],
            rng.normal(size=10),
        )
        for _ in range(COUNT)
    ]  # fmt: skip


def worst(cases, question, kernels, others):
    """Return the largest relative difference between the results of two implementations, over all cases and results."""
    found = []
    for case in cases:
        answers = [question(implementation, *case) for implementation in (kernels, others)]
        if isinstance(answers[0], np.ndarray):
            answers = [(answer,) for answer in answers]
        found += [relative_error(ours, theirs) for ours, theirs in zip(*answers, strict=True)]
    return max(found)


QUESTIONS = {
    "right-hand side": lambda k, bodies, y, b, a: k.rhs(HULL, bodies, y, b),
    "Jacobian": lambda k, bodies, y, b, a: k.jacobian(HULL, bodies, y),
    "product": lambda k, bodies, y, b, a: k.rates_vjp(HULL, bodies, y[SENSED], a),
    "step": lambda k, bodies, y, b, a: k.step(HULL, bodies, y[SENSED], b, H),
    "transpose of the step": lambda k, bodies, y, b, a: k.step_vjp(HULL, bodies, y[SENSED], b, a, H),
    "filter's tangent": lambda k, bodies, y, b, a: k.tangent(
        HULL, bodies, np.concatenate([y[SENSED], b, y[3:5]]), DECAY, H
    ),
}


@pytest.mark.parametrize("question", QUESTIONS)
def test_fortran_and_numba_agree(cases, numba_kernels, fortran_kernels, question):
    """They agree to 1e-12 of the largest entry."""
    assert worst(cases, QUESTIONS[question], fortran_kernels, numba_kernels) < 1e-12


def test_gradients_agree(numba_kernels, fortran_kernels):
    """Cost and gradients of windows, by the disturbance and by the initial state, agree to 1e-10."""
    rng = np.random.default_rng(1)
    n = scaled(60, 6)
    for _ in range(5):
        bodies, state0 = LOPSIDED.bodies(random_controls(rng, n)), random_state(rng)
        state0[6] = 0.4
        flown = numba_kernels.simulate(HULL, bodies, state0, random_disturbances(rng, n), H)
        measured = flown[:, [0, 1, 2, 5]] + rng.normal(size=(n + 1, 4)) * [0.01, 0.01, 0.01, 0.1]
        weights = (rng.uniform(size=n + 1) > 0.2).astype(float)
        given = HULL, bodies, state0, random_disturbances(rng, n), measured, weights, H
        for ours, theirs in zip(fortran_kernels.window(*given), numba_kernels.window(*given), strict=True):
            assert relative_error(ours, theirs) < 1e-10


@pytest.mark.parametrize("where", range(10))
def test_nan_in_a_state_propagates(cases, fortran_kernels, where):
    """A NaN in a state is also in the new state and, except for the heading, in the transposed derivatives."""
    bodies, state, b, a = cases[0]
    y = state[SENSED]
    y[where] = np.nan
    new = fortran_kernels.step(HULL, bodies, y, b, H)
    assert np.isnan(new[where])
    if where != 2:
        assert np.isnan(np.concatenate(fortran_kernels.step_vjp(HULL, bodies, y, b, a, H))).any()


# The build and the handshake


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """Copy the sources to a separate folder, in which the library is built."""
    for source in build.FOLDER.glob("*.f90"):
        shutil.copy(source, tmp_path)
    monkeypatch.setattr(build, "FOLDER", tmp_path)
    return tmp_path


@compiler
def test_a_library_is_built_and_loaded_where_it_belongs(elsewhere, cases):
    """The build works without optimisation, and with flags that would hide NaN, which ours override."""
    path = build.build(flags="-O0 -ffinite-math-only -fassociative-math")
    assert path.parent == elsewhere
    assert [file.name for file in elsewhere.iterdir() if file.suffix != ".f90"] == [path.name]
    opened = library._opened(path)
    assert opened.flags == "-O0 -ffinite-math-only -fassociative-math"
    assert "GCC" in opened.compiler
    assert fortran_check.difference(opened) < 1e-12
    angle = np.empty(1)
    opened.kernels["wrap"](1, np.array([np.nan]), angle)
    assert np.isnan(angle[0])


@compiler
def test_a_library_of_other_lanes_is_refused(elsewhere):
    other = build.build(flags="-O0", lanes=12 - LANES)
    with pytest.raises(library.LibraryError, match=f"was built for lanes {12 - LANES}, but {LANES} is needed here"):
        library._opened(other)


@compiler
def test_a_library_of_other_sources_is_refused(elsewhere):
    path = build.build(flags="-O0")
    with (elsewhere / "rk4.f90").open("a") as file:
        file.write("! changed\n")
    with pytest.raises(library.LibraryError, match=r"not built from the sources next to it.*make fortran"):
        library._opened(path)


def test_a_library_that_is_not_there_is_asked_for(tmp_path):
    with pytest.raises(library.LibraryError, match=r"not built for .* lanes .*nowhere.so is missing.*`make fortran`"):
        library._opened(tmp_path / "nowhere.so")


def test_a_file_that_is_no_library_is_refused(tmp_path):
    path = tmp_path / "damaged.so"
    path.write_bytes(b"no library")
    with pytest.raises(library.LibraryError, match=r"cannot be loaded .*make fortran"):
        library._opened(path)


@pytest.mark.parametrize(
    ("layout", "complaint"),
    [
        ((0, LANES, 24, 11, 62, 67, 2), "interface version 0, but 1 is needed"),
        ((1, LANES, 23, 11, 62, 67, 2), "numbers of a hull 23, but 24 is needed here"),
        ((1, LANES, 24, 11, 50, 67, 2), "numbers of a step on the tape 50, but 62 is needed here"),
    ],
)
def test_another_layout_is_refused(layout, complaint):
    with pytest.raises(library.LibraryError, match=complaint):
        library._check(Path("other.so"), layout, build.source_digest())


def test_a_narrower_processor_is_refused(monkeypatch):
    """On such a processor, a library of wide vectors would fail with an illegal instruction."""
    monkeypatch.setattr(library.llvmlite.binding, "get_host_cpu_features", lambda: {"avx2": True})
    layout = tuple(library._LAYOUT.values())
    with pytest.raises(library.LibraryError, match="uses avx512f, which this processor does not have"):
        library._check(Path("wide.so"), (*layout, 8), build.source_digest())
    library._check(Path("narrow.so"), (*layout, 4), build.source_digest())


def test_a_missing_compiler_is_named():
    with pytest.raises(build.BuildError, match="no Fortran compiler 'gfortran-of-nobody' on the path; install one"):
        build.build(compiler="gfortran-of-nobody")


def test_a_folder_that_cannot_be_written_is_named(monkeypatch):
    def refused(**where):
        raise PermissionError(13, "Permission denied", str(where["dir"]))

    monkeypatch.setattr(build.tempfile, "TemporaryDirectory", refused)
    with pytest.raises(build.BuildError, match=r"fortran: cannot be written \(Permission denied\)"):
        build.build()


def test_the_build_command_prints_the_path_of_the_library(monkeypatch, capsys):
    asked = []
    monkeypatch.setattr(build, "build", lambda *options: asked.append(options) or Path("made.so"))
    monkeypatch.setattr("sys.argv", ["build", "--compiler=gfortran-13", "--flags=-O3 -march=haswell", "--lanes=4"])
    build.main()
    assert asked == [("gfortran-13", "-O3 -march=haswell", 4)]
    assert capsys.readouterr().out == "built made.so\n"


def test_the_command_fails_on_one_line(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["build", "--compiler=gfortran-of-nobody"])
    with pytest.raises(SystemExit, match="1"):
        build.main()
    assert capsys.readouterr().err.startswith("error: no Fortran compiler 'gfortran-of-nobody'")


@compiler
def test_flags_that_the_compiler_refuses_are_reported(elsewhere, capfd):
    with pytest.raises(build.BuildError, match="gfortran ended with status 1"):
        build.build(flags="-fno-such-flag")
    assert "-fno-such-flag" in capfd.readouterr().err
    assert not list(elsewhere.glob("*.so"))


@pytest.mark.parametrize("flag", ["-Ofast", "-ffast-math"])
def test_flags_that_change_the_process_are_refused(flag):
    with pytest.raises(build.BuildError, match=f"flag {flag} would change the arithmetic of the whole program"):
        build.build(flags=f"-march=native {flag}")


# The built library


def test_the_check_holds_the_library_against_numba(fortran_kernels, capsys):
    fortran_check.main()
    out = capsys.readouterr().out
    assert f"{LANES} lanes" in out
    assert "differ from Numba's by" in out


def test_the_check_fails_where_the_library_is_wrong(fortran_kernels, monkeypatch, capsys):
    monkeypatch.setattr(fortran_check, "evaluated", _off_by_a_millionth(fortran_check.evaluated))
    with pytest.raises(SystemExit, match="1"):
        fortran_check.main()
    assert "rounding explains at most" in capsys.readouterr().err


def _off_by_a_millionth(evaluated):
    def off(*arguments):
        problem = evaluated(*arguments)
        problem.gradient[...] *= 1.0 + 1e-6
        return problem

    return off


@pytest.mark.skipif(shutil.which("objdump") is None, reason="no objdump here")
def test_the_loops_over_lanes_are_vectorised(fortran_kernels):
    """A call or a branch that the compiler cannot remove would leave scalar code, which is eight times as slow."""
    code = subprocess.run(
        ["objdump", "-d", "--no-show-raw-insn", str(library.load().path)], capture_output=True, text=True, check=True
    ).stdout
    bodies = {part.split(">:")[0].split("<")[-1]: part for part in code.split("\n\n") if ">:" in part}
    for name, least in (("__window_MOD_forward", 600), ("__window_MOD_adjoint", 1000), ("gliderhpc_pull_back", 300)):
        counts = arithmetic_of(bodies[name])
        whole = counts.get(LANES, 0)
        assert whole >= least, (name, counts)
        assert sum(counts.values()) - whole <= 0.01 * whole, (name, counts)


# The engine


@pytest.mark.long
@compiled
def test_a_mission_by_the_fortran_engine(brief, brief_store, fortran_kernels):
    """The archive names the engine; other results agree with the lanes engine as closely as rounding permits."""
    store = brief.with_name("brief-fortran.zarr")
    answer = program("run-mission", brief, *WHOLE, "--store", store, "--engine", "fortran")
    assert answer.status == 0, answer.err
    with open_mission(store) as ours, open_mission(brief_store) as theirs:
        assert (ours.attrs["engine"], theirs.attrs["engine"]) == ("fortran", "lanes")
        assert ours.attrs["settings"]["engine"] == "fortran"
        for name in ("outcome", "start", "stop"):
            np.testing.assert_array_equal(ours[f"windows/{name}"].values, theirs[f"windows/{name}"].values)
        counts = [np.nanmedian(archive["windows/iterations"].values) for archive in (ours, theirs)]
        assert counts[0] == pytest.approx(counts[1], abs=1.0)
        for name in ("dac_north", "dac_east"):
            np.testing.assert_allclose(ours[name].values, theirs[name].values, rtol=0.0, atol=1e-3)
    summary = program("info", store)
    assert summary.status == 0
    assert "fortran" in summary.out
    assert summary.out.replace("fortran", "lanes").count("lanes") == program("info", brief_store).out.count("lanes") + 1


@compiled
def test_an_engine_that_is_not_built_is_refused_before_anything_is_done(brief, monkeypatch):
    def missing():
        raise library.LibraryError(f"the Fortran kernels are not built for {LANES} lanes; {library.HOW}")

    monkeypatch.setattr(engines, "load", missing)
    store = brief.with_name("never.zarr")
    answer = program("run-mission", brief, *WHOLE, "--store", store, "--engine", "fortran")
    assert answer.status == 2
    assert "engine fortran" in answer.line
    assert "make fortran" in answer.line
    assert not store.exists()
    with pytest.raises(InputError, match="make fortran"):
        engines.FortranRun()


def test_the_default_needs_no_compiler():
    assert EstimationSettings().engine == "lanes"


def test_implementations_are_skipped_with_the_reason(monkeypatch):
    """A run of the tests without built kernels shows the reason."""
    monkeypatch.setattr("support.implementations.load_library", lambda: library._opened(Path("nowhere.so")))
    with pytest.raises(pytest.skip.Exception, match="make fortran"):
        implementation_named("fortran")
