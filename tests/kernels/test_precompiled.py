"""Precompiled kernels: used if they were compiled for this process; nothing else is changed or trusted."""

import json
import logging
import shutil
from pathlib import Path

import llvmlite.binding
import numba
import pytest
from support.programs import python

from gliderhpc.kernels import lane_type, precompiled
from gliderhpc.kernels.precompiled import (
    LEVELS,
    MANIFEST,
    VARIABLE,
    NotUsable,
    find_precompiled,
    host_level,
    level_features,
    made_for,
    precompiled_kernels,
)  # fmt: skip

compiled = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
level_known = pytest.mark.skipif(not host_level(), reason="this processor has no level of x86-64")

LIST_SIGNATURES = """
import pickle
import gliderhpc, numpy as np
from gliderhpc.mission.precompile import used_signatures
gliderhpc.Glider(gliderhpc.platform.read_platform("petrel-l")).bodies(np.zeros((1, 5)))
print(pickle.dumps(used_signatures()).hex())
"""

COUNT_COMPILED = """
import json
from numba.core import event
with event.install_recorder("numba:compile") as events:
    import gliderhpc, numpy as np
    bodies = gliderhpc.Glider(gliderhpc.platform.read_platform("petrel-l")).bodies(np.zeros((1, 5)))
print(json.dumps([len(events.buffer), bodies.tolist() if hasattr(bodies, "tolist") else repr(bodies)]))
"""


@pytest.fixture(scope="module")
def signatures(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the signatures of the kernel that computes a glider's bodies, pickled, as hexadecimal digits."""
    return python(LIST_SIGNATURES, GLIDERHPC_CACHE=tmp_path_factory.mktemp("cache")).stdout.strip()


def make(folder: Path, signatures: str) -> Path:
    """Compile kernels into a folder, for this processor's level, in a process with another cache."""
    python(
        "import pickle\nfrom pathlib import Path\nfrom gliderhpc.mission.precompile import precompile\n"
        f"precompile(Path({str(folder)!r}), pickle.loads(bytes.fromhex({signatures!r})), [{host_level()!r}])\n",
        GLIDERHPC_CACHE=folder.parent / "other-cache",
    )
    return folder


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, signatures: str) -> Path:
    """Return a folder with that kernel, which no test changes."""
    return make(tmp_path_factory.mktemp("made") / "kernels", signatures)


def content(folder: Path) -> dict[str, bytes]:
    """Return the bytes of every file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.long
@compiled
@level_known
def test_precompiled_kernels_are_neither_recompiled_nor_changed(tmp_path: Path, made: Path) -> None:
    before = content(made)
    assert len(before) > 2
    done = python(COUNT_COMPILED, GLIDERHPC_KERNELS=made, GLIDERHPC_CACHE=tmp_path / "cache")
    here = python(COUNT_COMPILED, GLIDERHPC_CACHE=tmp_path / "cache")
    events, bodies = json.loads(done.stdout)
    assert events == 0
    assert not done.stderr
    own_events, own_bodies = json.loads(here.stdout)
    assert own_events > 0
    assert bodies == own_bodies
    assert content(made) == before


@pytest.mark.long
@compiled
@level_known
def test_a_damaged_folder_is_left_alone_and_the_kernel_compiled_here(tmp_path: Path, made: Path) -> None:
    folder = shutil.copytree(made, tmp_path / "kernels")
    for path in folder.rglob("*.nbc"):
        path.write_bytes(path.read_bytes()[:50])
    before = content(folder)
    done = python(COUNT_COMPILED, GLIDERHPC_KERNELS=folder, GLIDERHPC_CACHE=tmp_path / "cache")
    assert json.loads(done.stdout)[0] > 0
    assert "are damaged" in done.stderr
    assert content(folder) == before
    assert json.loads(python(COUNT_COMPILED, GLIDERHPC_CACHE=tmp_path / "cache").stdout)[0] == 0


@pytest.mark.long
@compiled
@level_known
def test_the_same_sources_give_the_same_bytes(tmp_path: Path, made: Path, signatures: str) -> None:
    assert content(make(tmp_path / "again", signatures)) == content(made)


@pytest.fixture
def named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder that the variable names; its manifest fits this process at the level x86-64-v3."""
    folder = tmp_path / "kernels"
    (folder / "x86-64-v3").mkdir(parents=True, mode=0o700)
    (folder / MANIFEST).write_text(json.dumps({**made_for(), "levels": ["x86-64-v3"]}))
    monkeypatch.setenv(VARIABLE, str(folder))
    monkeypatch.setattr(precompiled, "host_level", lambda: "x86-64-v3")
    return folder


def test_a_folder_made_for_this_process_is_found(named: Path) -> None:
    assert find_precompiled() == named / "x86-64-v3"


@pytest.mark.parametrize("name", ["sources", "python", "numba", "llvmlite", "system"])
def test_a_folder_made_for_something_else_is_not_used(named: Path, name: str) -> None:
    (named / MANIFEST).write_text(json.dumps({**made_for(), "levels": ["x86-64-v3"], name: "another"}))
    with pytest.raises(NotUsable, match="other sources" if name == "sources" else f"{name} another"):
        find_precompiled()


def test_another_level_is_not_used(named: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(precompiled, "host_level", lambda: "x86-64-v2")
    with pytest.raises(NotUsable, match="for x86-64-v3, not for x86-64-v2"):
        find_precompiled()


def test_a_folder_that_others_can_write_is_not_used(named: Path) -> None:
    (named / "x86-64-v3").chmod(0o777)
    with pytest.raises(NotUsable, match="every user can write to it"):
        find_precompiled()


@pytest.mark.parametrize("text", [None, "{", "[]", "\0", '{"levels": 3}', "{}"])
def test_an_absent_or_damaged_manifest_is_reported(named: Path, text: str | None) -> None:
    (named / MANIFEST).unlink()
    if text is not None:
        (named / MANIFEST).write_text(text)
    with pytest.raises(NotUsable, match="no compiled kernels"):
        find_precompiled()


def test_a_named_folder_that_is_not_used_is_warned_of(named: Path, caplog: pytest.LogCaptureFixture) -> None:
    """There is no warning of an unused folder of the installation, which was not requested."""
    (named / MANIFEST).unlink()
    folder, reason = precompiled_kernels.__wrapped__()
    assert folder is None
    assert str(named) in reason
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    assert reason in caplog.text


def test_a_checkout_has_none(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(precompiled, "SHIPPED", Path("no such folder"))
    assert precompiled_kernels.__wrapped__() == (None, "none in this installation")
    assert not caplog.records


def test_vectors_are_as_wide_as_the_level_has_them() -> None:
    assert level_features("x86-64-v3").split(",") == [f"+{name}" for name in LEVELS["x86-64-v3"]]
    assert "-prefer-256-bit" in level_features("x86-64-v4").split(",")


def test_numba_set_to_another_processor_uses_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "CPU_NAME", "generic")
    assert host_level() == ""


def test_a_higher_level_has_all_features_of_the_lower() -> None:
    for higher, lower in zip([*LEVELS.values()][:-1], [*LEVELS.values()][1:], strict=True):
        assert set(lower) < set(higher)


@pytest.mark.parametrize(("lanes", "missing", "level"), [
    (8, (), "x86-64-v4"), (8, ("avx512vl",), ""), (8, ("movbe",), ""),
    (4, (), "x86-64-v3"), (4, ("avx512f",), "x86-64-v3"),
])  # fmt: skip
def test_a_level_with_another_number_of_lanes_does_not_count(
    monkeypatch: pytest.MonkeyPatch, lanes: int, missing: tuple[str, ...], level: str
) -> None:
    """The number is part of the code: with another one, kernels would read and write beyond their lanes."""
    features = {name: name not in missing for name in LEVELS["x86-64-v4"]}
    monkeypatch.setattr(llvmlite.binding, "get_host_cpu_features", lambda: features)
    monkeypatch.setattr(precompiled.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(lane_type, "LANES", lanes)
    assert host_level() == level
