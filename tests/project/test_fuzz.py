"""Unusual inputs, damaged archives and kills: invariants, on earlier failures and on drawn inputs."""

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from benchmarks.fuzz import run_recipe
from benchmarks.fuzzing.kills import COMMANDS
from benchmarks.fuzzing.kinds import RUN, SkippedError
from benchmarks.fuzzing.program import Call, Program
from benchmarks.fuzzing.specimens import Specimens
from benchmarks.fuzzing.strategies import KINDS
from benchmarks.fuzzing.verdicts import Fault, changes, ended_well, snapshot, traced

pytestmark = pytest.mark.compiled

REPOSITORY = Path(__file__).resolve().parents[2]
WAITING = ("new-archive-with-no-scheduler", "overwrite-with-no-scheduler")
"""Cases that wait half a minute for a scheduler; test_creation.py has the same with less patience."""
CORPUS = sorted(path for path in (REPOSITORY / "tests" / "corpus").glob("*.json") if path.stem not in WAITING)
OPEN = json.loads((REPOSITORY / "tests" / "corpus" / "open" / "open.json").read_text("utf-8"))
"""Cases of the corpus that are not mended, by name, and causes that drawn inputs may still find, by kind."""

DRAWN = {"seaexplorer": 8, "slocum": 8, "slocum-netcdf": 6, "seaglider": 6, "og1": 8, "yaml": 14, "command-line": 10}
"""Inputs drawn by kind: the parsers, which need no kernels; `make fuzz` draws thousands of all kinds."""


@pytest.fixture(scope="module")
def program():
    with Program(REPOSITORY, limit=60.0) as started:
        yield started


@pytest.fixture(scope="module")
def specimens(program, tmp_path_factory):
    return Specimens(tmp_path_factory.mktemp("specimens"), program)


LONG_CASES = ("archive-chunk-deleted-check", "archive-chunk-deleted-info", "full-disk-report")


def _case(path):
    marks = (
        [pytest.mark.xfail(strict=True, reason="not mended: see the page Reliability")]
        if path.stem in OPEN["cases"]
        else []
    )
    if path.stem in LONG_CASES:
        marks.append(pytest.mark.long)
    return pytest.param(path, id=path.stem, marks=marks)


@pytest.mark.parametrize("path", [_case(path) for path in CORPUS])
def test_recorded_fuzzing_faults_do_not_recur(path, program, specimens, tmp_path):
    recipe = json.loads(path.read_text("utf-8"))["recipe"]
    try:
        case = run_recipe(recipe, program, specimens, tmp_path / "case")
    except SkippedError as why:
        pytest.skip(f"cannot be made here: {why}")
    assert case.faults == [], case.transcript


@pytest.mark.long
@pytest.mark.parametrize("kind", DRAWN)
def test_drawn_inputs(kind, program, specimens, tmp_path):
    found = {}

    @settings(
        max_examples=DRAWN[kind], derandomize=True, database=None, deadline=None, phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(KINDS[kind][0])
    def trial(recipe):
        try:
            case = run_recipe(recipe, program, specimens, tmp_path / "case")
        except SkippedError:
            return
        found.update({f"{fault.name}: {fault.detail}": recipe for fault in case.faults})

    trial()
    assert {cause: recipe for cause, recipe in found.items() if cause not in OPEN["causes"]} == {}


# The harness itself: a check that finds nothing must have looked


def test_every_kind_can_be_run():
    assert set(KINDS) <= set(RUN)
    assert all(mending[0] == first[0] for first, mending, _ in COMMANDS.values())


def test_recipes_survive_their_file():
    @settings(max_examples=50, derandomize=True, database=None, deadline=None)
    @given(st.one_of(*(recipes for recipes, _ in KINDS.values())))
    def trial(recipe):
        assert json.dumps(json.loads(json.dumps(recipe))) == json.dumps(recipe)

    trial()


def test_a_changed_a_lost_and_a_new_file_are_found(tmp_path):
    for name in ("input", "other", "out"):
        (tmp_path / name).write_text(name)
    before = snapshot(tmp_path)
    (tmp_path / "input").write_text("changed")
    (tmp_path / "other").unlink()
    (tmp_path / "out").write_text("made")
    (tmp_path / "more").touch()
    after = snapshot(tmp_path)
    found = {(fault.name, fault.detail) for fault in changes(before, after, ("out",), 0)}
    assert found == {
        ("changed", "input changed"),
        ("lost", "other is gone, or part of it"),
        ("changed", "more left behind"),
    }
    assert Fault("changed", "out changed by a refused command") in changes(before, after, ("out",), 2)


def test_a_traceback_is_named_by_its_cause():
    text = (
        'Traceback (most recent call last):\n  File "/a/gliderhpc/observations/instruments/og1.py", line 12, in times\n'
        "    x()\nValueError: 17 is not 'x'\n"
    )
    assert traced(text) == "ValueError: N is not N in gliderhpc/observations/instruments/og1.py:times"
    assert traced("gliderhpc: in.nc: no such file") is None


def test_a_call_is_killed_limited_and_seen(program, tmp_path):
    assert program.run(Call(("platforms",), tmp_path)).status == 0
    assert program.run(Call(("platforms", "none"), tmp_path)).status == 2
    killed = program.run(Call(("platforms", "petrel-l"), tmp_path, kill=(0.0, 9)))
    assert (killed.killed, killed.status) == (True, -9)
    assert ended_well(killed, program.memory) == []
    program.limit, limit = 0.0, program.limit
    hung = program.run(Call(("platforms", "petrel-l"), tmp_path))
    program.limit = limit
    assert [fault.name for fault in ended_well(hung, program.memory)] == ["hangs"]
