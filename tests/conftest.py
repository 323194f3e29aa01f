"""Fixtures shared by the whole suite."""

import gc
import json
import os
import shutil
import sys
from dataclasses import asdict
from pathlib import Path

import psutil
import pytest
import threadpoolctl
from support.archives import schema_digest
from support.implementations import IMPLEMENTATIONS, Implementation, implementation_named
from support.missions import BRIEF, SWIFT, Answer, estimate, program
from support.repository import REPOSITORY
from support.sharing import CompiledKernels, made_once
from support.shown import leave_studies_undrawn

from gliderhpc.platform import read_platform
from gliderhpc.simulator import load_scenario, simulate_mission
from gliderhpc.store_schema import check_archive, is_archive

MODULES_FIRST = (
    "test_docs.py", "test_report.py", "test_mission.py", "test_faults.py", "test_calibration.py", "test_watch.py",
    "test_api.py", "test_commits.py", "test_slurm.py", "test_fuzz.py", "test_object_store.py", "test_drift.py",
    "test_turbulence_studies.py", "test_vertical.py", "test_twin_studies.py", "test_fleet.py", "test_hull_rounds.py",
    "test_real_missions.py", "test_reconstruction.py", "test_damaged_archives.py", "test_cli.py",
    "test_motion_figure.py", "test_engines_agree.py", "test_benchmarks.py",
)  # fmt: skip
"""Modules that take longest: no worker shall begin one of them when the others have nothing left to do."""

QUICK_MODULES = (
    "test_adjoint.py", "test_currents.py", "test_dynamics.py", "test_elementary.py", "test_filter.py",
    "test_lane_window.py", "test_likelihood.py", "test_line_search.py", "test_moving_water.py", "test_observations.py",
    "test_og1.py", "test_platform.py", "test_profiles.py", "test_quasi_newton.py", "test_resample.py",
    "test_seaexplorer.py", "test_slocum.py", "test_smoother_noise.py", "test_steady_balance.py", "test_steady_glide.py",
    "test_stretches.py", "test_synthetic.py", "test_turbulence.py", "test_twin_core.py", "test_twin_estimators.py",
    "test_windows.py", "test_yaml_text.py", "test_import_faults.py", "test_output_files.py",
    "test_plausibility.py", "test_seaexplorer_legs.py", "test_least_squares.py", "test_fisher_scoring.py",
    "test_compass_likelihood.py",
)  # fmt: skip
"""Modules for `make test-quick`: kernels, model, filter, windows, readers and the format; no mission is inverted."""


LONG_FIXTURES = {
    "test_calibration.py": ("twins",), "test_docs.py": ("site",), "test_gusts.py": ("statistics",),
    "test_machine_code.py": ("here", "narrower"), "test_tuning.py": ("tuned",), "test_twin_currents.py": ("findings",),
    "test_twin_studies.py": ("windows", "sensitivity", "recoverability", "estimators"),
}  # fmt: skip
"""Fixtures that take so long that every test that uses one is `long`."""

DRAWING_FOLDERS = ("studies", "twins", "project")
"""Folders of tests in which the figures that a study writes are drawn."""


def pytest_xdist_auto_num_workers() -> int:
    """Number of test workers for ``-n auto``: two more than the cores that this process may use, eight at most.

    Tests wait for processes that start or are to be killed: four workers on two cores need about a twentieth less time
    than three.
    """
    return min(len(os.sched_getaffinity(0)) + 2, 8)


MEMORY = Path("/dev/shm")
"""Folder in memory, where a system has one."""

ALLOCATIONS = 100_000
"""Number of new containers after which the youngest are searched for garbage; with a tenth of it, searching takes a
twenty-fifth of the tests' time."""

IN_MEMORY = MEMORY / f"gliderhpc-tests-{os.getpid()}"
"""The tests' folders there."""

ROOM = 8e9
"""Free memory (bytes) from which the tests' folders are in memory; a whole run makes a hundred thousand small files."""


BLAS_THREADS = "OPENBLAS_NUM_THREADS"
"""Variable of the environment with the number of threads for linear algebra."""


def pytest_configure(config: pytest.Config) -> None:
    """Put the tests' folders in memory if there is room and no other place is asked for.

    Linear algebra gets one thread, in this process and in those that it starts: with a thread for each core, the
    decomposition of a small matrix takes thirty times the processor time, in which threads wait for each other.

    Search for garbage less often than the program does: a worker has a great many objects that live to its end.

    Imported modules are stored compiled even where the environment says otherwise: the tests start a hundred processes
    that import them.
    """
    gc.set_threshold(ALLOCATIONS)
    os.environ.setdefault(BLAS_THREADS, "1")
    threadpoolctl.threadpool_limits(int(os.environ[BLAS_THREADS]), user_api="blas")
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False
    is_worker = hasattr(config, "workerinput")
    if not is_worker and config.option.basetemp is None and _has_room(MEMORY):
        config.option.basetemp = str(IN_MEMORY)


def _has_room(folder: Path) -> bool:
    if not (folder.is_dir() and os.access(folder, os.W_OK)) or os.statvfs(folder).f_flag & os.ST_NOEXEC:
        return False
    return min(shutil.disk_usage(folder).free, psutil.virtual_memory().available) > ROOM


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Free the memory that the tests' folders take; folders elsewhere stay, as pytest leaves them."""
    if not hasattr(session.config, "workerinput") and session.config.option.basetemp == str(IN_MEMORY):
        shutil.rmtree(IN_MEMORY, ignore_errors=True)


COMPILING = pytest.StashKey[CompiledKernels]()


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Begin to compile the kernels; the test workers start, and find their tests, meanwhile."""
    if not hasattr(session.config, "workerinput") and not session.config.option.collectonly:
        session.config.stash[COMPILING] = CompiledKernels()


def pytest_collection_finish() -> None:
    """Collect garbage once, then exclude the modules and collected tests, which live to the end."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop(session: pytest.Session) -> None:
    """Wait for the kernels before the first test."""
    if COMPILING in session.config.stash:
        session.config.stash[COMPILING].wait()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark what is slow or long, and put the longest modules first unless the order is to be random."""
    for item in items:
        if not set(LONG_FIXTURES.get(item.path.name, ())).isdisjoint(getattr(item, "fixturenames", ())):
            item.add_marker("long")
        if item.path.name not in QUICK_MODULES:
            item.add_marker("slow")
    if not config.pluginmanager.has_plugin("randomly"):
        places = {name: place for place, name in enumerate(MODULES_FIRST)}
        items.sort(key=lambda item: places.get(item.path.name, len(places)))


def _shared(name: str) -> Path:
    folder = REPOSITORY.parent / "shared" / name
    if not folder.is_dir():
        pytest.skip(f"{folder.name} is not next to this checkout")
    return folder


@pytest.fixture(scope="session", params=list(IMPLEMENTATIONS))
def implementation(request: pytest.FixtureRequest) -> Implementation:
    """Each implementation of the kernels in turn."""
    return implementation_named(request.param)


@pytest.fixture(scope="session")
def numba_kernels() -> Implementation:
    """The kernels in Numba."""
    return implementation_named("numba")


@pytest.fixture(scope="session")
def fortran_kernels() -> Implementation:
    """The kernels in Fortran."""
    return implementation_named("fortran")


@pytest.fixture(scope="session")
def _not_to_check() -> set[Path]:
    """Archives not to be checked against the schema: checked already, or damaged by a test on purpose."""
    return set()


@pytest.fixture(autouse=True)
def _skip_damaged_archives(request, _not_to_check):
    """Archives that a test marked ``damages_archive`` leaves are not checked against the schema."""
    damages_archive = request.node.get_closest_marker("damages_archive") is not None
    folder = request.getfixturevalue("tmp_path") if damages_archive else None
    yield
    if folder is not None:
        _not_to_check.update(_archives(folder))


@pytest.fixture(scope="session")
def _sound() -> set[str]:
    """Digests, by `schema_digest`, of archives that conform to the schema."""
    return set()


@pytest.fixture(scope="module", autouse=True)
def _sound_archives(tmp_path_factory, _not_to_check, _sound):
    """Hold every archive that a module's tests made against the schema; they may hold anything else that they like.

    Of archives that are alike in all that the schema speaks of, such as copies, one is looked at.
    """
    yield
    made = set(_archives(tmp_path_factory.getbasetemp())) - _not_to_check
    _not_to_check.update(made)
    wrong = {}
    for path in filter(is_archive, made):
        if (digest := schema_digest(path)) not in _sound:
            if differences := check_archive(path):
                wrong[path] = differences
            else:
                _sound.add(digest)
    assert wrong == {}


def _archives(folder: Path) -> list[Path]:
    found = [*folder.glob("*/*.zarr"), *folder.glob("*.zarr")]
    return [path for path in found if path.is_dir() and not path.parent.is_symlink()]


@pytest.fixture(scope="module", autouse=True)
def _undrawn_elsewhere(request):
    """Draw the figures of studies and twins, a third of the time of a short study, in the tests of these alone."""
    with pytest.MonkeyPatch.context() as patch:
        if request.path.parent.name not in DRAWING_FOLDERS:
            leave_studies_undrawn(patch)
        yield


@pytest.fixture
def unchecked_records(monkeypatch):
    """Runs of the program that do not look for errors of the records first, a tenth of the time of a short one."""
    monkeypatch.setattr("gliderhpc.api.missions.warn_about_records", lambda *_: None)


@pytest.fixture
def undrawn_studies(monkeypatch):
    """Studies whose figures are made but not drawn: the tests of each study draw theirs."""
    leave_studies_undrawn(monkeypatch)


@pytest.fixture
def undrawn(monkeypatch):
    """Pages whose figures are made but not drawn, for tests of their text and their files."""
    monkeypatch.setattr("gliderhpc.findings.drawing.render_image", lambda figure, form: form.encode())


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real glider files next to the checkout; the test is skipped where it is absent."""
    return _shared("data")


@pytest.fixture(scope="session")
def oracle() -> Path:
    """Folder of values from independent automatic differentiation."""
    return _shared("oracle")


@pytest.fixture(scope="session")
def twin(tmp_path_factory):
    """Observation file of four profiles of petrel-l, 42 minutes and 200 m each; the truth lies next to it."""
    folder = made_once(
        tmp_path_factory, "twin", lambda folder: simulate_mission(read_platform("petrel-l"), folder / "twin.nc", seed=1)
    )
    return folder / "twin.nc"


@pytest.fixture(scope="session")
def recommended(twin, tmp_path_factory):
    """Archive of the twin mission by preset `recommended`."""
    return _estimated_once(tmp_path_factory, twin, "recommended")


@pytest.fixture(scope="session")
def paper(twin, tmp_path_factory):
    """Archive of the twin mission by preset `paper`."""
    return _estimated_once(tmp_path_factory, twin, "paper")


@pytest.fixture(scope="session")
def brief(tmp_path_factory):
    """Observation file of three profiles of petrel-l, nine minutes and 40 m each; the truth lies next to it."""

    def make(folder):
        simulate_mission(read_platform("petrel-l"), folder / "brief.nc", scenario=BRIEF, seed=3)

    return made_once(tmp_path_factory, "brief", make) / "brief.nc"


@pytest.fixture(scope="session")
def brief_run(brief, tmp_path_factory):
    """Result of the run that inverts the brief mission into ``brief.zarr`` in its folder."""

    def make(folder):
        store = brief.with_name("brief.zarr")
        answer = program("run-mission", brief, "--platform", "petrel-l", "--store", store, "--workers", 0)
        (folder / "answer.json").write_text(json.dumps(asdict(answer)), "utf-8")

    folder = made_once(tmp_path_factory, "brief-run", make)
    return Answer(**json.loads((folder / "answer.json").read_text("utf-8")))


@pytest.fixture(scope="session")
def brief_store(brief, brief_run):
    """Archive of the brief mission."""
    assert brief_run.status == 0, brief_run.err
    store = brief.with_name("brief.zarr")
    assert check_archive(store) == []
    return store


@pytest.fixture(scope="session")
def swift(tmp_path_factory):
    """Observation file of three profiles of petrel-l, three minutes and 15 m each: for how a run is made and mended."""

    def make(folder):
        simulate_mission(read_platform("petrel-l"), folder / "swift.nc", scenario=SWIFT, seed=3)

    return made_once(tmp_path_factory, "swift", make) / "swift.nc"


@pytest.fixture(scope="session")
def swift_store(swift, tmp_path_factory):
    """Archive of the swift mission by preset `recommended`."""
    return _estimated_once(tmp_path_factory, swift, "recommended")


@pytest.fixture(scope="session")
def rough(tmp_path_factory):
    """Observation file of one profile of petrel-l in sheared, gusty water, which the usual prior cannot follow."""
    scenario = load_scenario("paper").replaced({"depth": 60.0, "depth_spread": 0.0, "profiles": 1})

    def make(folder):
        simulate_mission(read_platform("petrel-l"), folder / "rough.nc", scenario=scenario, seed=0)

    return made_once(tmp_path_factory, "rough", make) / "rough.nc"


@pytest.fixture(scope="session")
def rough_store(rough, tmp_path_factory):
    """Archive of the mission in rough water."""
    return _estimated_once(tmp_path_factory, rough, "recommended")


def _estimated_once(factory: pytest.TempPathFactory, observations: Path, preset: str) -> Path:
    """Archive of a mission with a preset, made once for all workers of the run and checked against the schema."""

    def make(folder):
        estimate(observations, folder / "mission.zarr", preset)
        assert check_archive(folder / "mission.zarr") == []

    return made_once(factory, f"{observations.stem}-{preset}", make) / "mission.zarr"
