"""Fixtures shared by the whole suite."""

# It names numba's cache folder; numba, once imported, would read its settings anew at the first compilation.
import gliderhpc  # noqa: F401  # isort: skip

from pathlib import Path

import pytest
from implementations import IMPLEMENTATIONS, Implementation, implementation_named
from missions import BRIEF, estimate, program

from gliderhpc.observations.synthetic import load_scenario, simulate_mission
from gliderhpc.platform import read_platform
from gliderhpc.store_schema import check_archive, is_archive

REPOSITORY = Path(__file__).resolve().parents[1]


def _shared(name: str) -> Path:
    folder = REPOSITORY.parent / "shared" / name
    if not folder.is_dir():
        pytest.skip(f"{folder.name} is not beside this checkout")
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
def _looked_at() -> set[Path]:
    """Archives that are no longer to be held against the schema: they were, or a test spoilt them on purpose."""
    return set()


@pytest.fixture(autouse=True)
def _spoilt_archives(request, _looked_at):
    """What a test marked ``spoils`` leaves is not held against the schema."""
    spoils = request.node.get_closest_marker("spoils") is not None
    folder = request.getfixturevalue("tmp_path") if spoils else None
    yield
    if folder is not None:
        _looked_at.update(_archives(folder))


@pytest.fixture(scope="module", autouse=True)
def _sound_archives(tmp_path_factory, _looked_at):
    """Hold every archive that a module's tests made against the schema; they may hold anything else that they like."""
    yield
    made = set(_archives(tmp_path_factory.getbasetemp())) - _looked_at
    _looked_at.update(made)
    wrong = {path: differences for path in made if is_archive(path) and (differences := check_archive(path))}
    assert wrong == {}


def _archives(folder: Path) -> list[Path]:
    found = [*folder.glob("*/*.zarr"), *folder.glob("*.zarr")]
    return [path for path in found if path.is_dir() and not path.parent.is_symlink()]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real glider files beside the checkout; the test is skipped where it is absent."""
    return _shared("data")


@pytest.fixture(scope="session")
def oracle() -> Path:
    """Folder of values from independent automatic differentiation."""
    return _shared("oracle")


@pytest.fixture(scope="session")
def twin(tmp_path_factory):
    """Observation file of four profiles of petrel-l, 42 minutes and 200 m each; the truth lies beside it."""
    folder = tmp_path_factory.mktemp("twin")
    return simulate_mission(read_platform("petrel-l"), folder / "twin.nc", seed=1).path


@pytest.fixture(scope="session")
def recommended(twin):
    """Archive of the twin mission by preset `recommended`."""
    store = twin.with_name("recommended.zarr")
    estimate(twin, store, "recommended")
    return store


@pytest.fixture(scope="session")
def paper(twin):
    """Archive of the twin mission by preset `paper`."""
    store = twin.with_name("paper.zarr")
    estimate(twin, store, "paper")
    return store


@pytest.fixture(scope="session")
def brief(tmp_path_factory):
    """Observation file of three profiles of petrel-l, nine minutes and 40 m each; the truth lies beside it."""
    folder = tmp_path_factory.mktemp("brief")
    return simulate_mission(read_platform("petrel-l"), folder / "brief.nc", scenario=BRIEF, seed=3).path


@pytest.fixture(scope="session")
def brief_run(brief):
    """What the program answered when it was asked to estimate the brief mission into ``brief.zarr`` beside it."""
    store = brief.with_name("brief.zarr")
    return program("run-mission", brief, "--platform", "petrel-l", "--store", store, "--workers", 0)


@pytest.fixture(scope="session")
def brief_store(brief, brief_run):
    """Archive of the brief mission."""
    assert brief_run.status == 0, brief_run.err
    return brief.with_name("brief.zarr")


@pytest.fixture(scope="session")
def rough(tmp_path_factory):
    """Observation file of one profile of petrel-l in sheared, gusty water, which the usual prior cannot follow."""
    folder = tmp_path_factory.mktemp("rough")
    scenario = load_scenario("paper").replaced({"depth": 60.0, "depth_spread": 0.0, "profiles": 1})
    return simulate_mission(read_platform("petrel-l"), folder / "rough.nc", scenario=scenario, seed=0).path


@pytest.fixture(scope="session")
def rough_store(rough):
    """Archive of the mission in rough water."""
    store = rough.with_name("rough.zarr")
    estimate(rough, store, "recommended")
    return store
