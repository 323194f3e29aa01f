"""Kernels compiled beforehand: used where they were made for this process, and nothing else is touched or trusted."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from gliderhpc.kernels import precompiled
from gliderhpc.kernels.precompiled import LEVELS, MANIFEST, VARIABLE, NotUsable, find_precompiled, host_level, made_for

compiled = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
level_known = pytest.mark.skipif(not host_level(), reason="this processor has no level of x86-64")

LIST_SIGNATURES = """
import pickle, sys
import gliderhpc, numpy as np
from gliderhpc.mission.kernel_levels import used_signatures
gliderhpc.Glider(gliderhpc.platform.read_platform("petrel-l")).bodies(np.zeros((1, 5)))
sys.stdout.buffer.write(pickle.dumps(used_signatures()))
"""

COUNT_COMPILED = """
import json
from numba.core import event
with event.install_recorder("numba:compile") as events:
    import gliderhpc, numpy as np
    bodies = gliderhpc.Glider(gliderhpc.platform.read_platform("petrel-l")).bodies(np.zeros((1, 5)))
print(json.dumps([len(events.buffer), bodies.tolist() if hasattr(bodies, "tolist") else repr(bodies)]))
"""


def python(code: str, **environment: object) -> subprocess.CompletedProcess[bytes]:
    """Run a program in a process of its own that must succeed."""
    given = {**os.environ, **{name: str(value) for name, value in environment.items()}}
    return subprocess.run([sys.executable, "-c", code], env=given, check=True, capture_output=True)


@pytest.fixture(scope="module")
def signatures(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Signatures of the one kernel that makes a glider's bodies, as bytes."""
    return python(LIST_SIGNATURES, GLIDERHPC_CACHE=tmp_path_factory.mktemp("cache")).stdout


def make(folder: Path, signatures: bytes) -> Path:
    """Compile kernels into a folder for this processor's level, in a process with another cache."""
    python(
        "import pickle\nfrom pathlib import Path\nfrom gliderhpc.mission.kernel_levels import precompile\n"
        f"precompile(Path({str(folder)!r}), pickle.loads({signatures!r}), [{host_level()!r}])\n",
        GLIDERHPC_CACHE=folder.parent / "other-cache",
    )
    return folder


def content(folder: Path) -> dict[str, bytes]:
    """Bytes of every file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@compiled
@level_known
def test_what_was_compiled_beforehand_is_not_compiled_and_not_changed(tmp_path: Path, signatures: bytes) -> None:
    folder = make(tmp_path / "kernels", signatures)
    before = content(folder)
    assert len(before) > 2
    done = python(COUNT_COMPILED, GLIDERHPC_KERNELS=folder, GLIDERHPC_CACHE=tmp_path / "cache")
    here = python(COUNT_COMPILED, GLIDERHPC_CACHE=tmp_path / "cache")
    events, bodies = json.loads(done.stdout)
    assert events == 0
    assert not done.stderr
    own_events, own_bodies = json.loads(here.stdout)
    assert own_events > 0
    assert bodies == own_bodies
    assert content(folder) == before


@compiled
@level_known
def test_a_damaged_folder_is_left_alone_and_the_kernel_compiled_here(tmp_path: Path, signatures: bytes) -> None:
    folder = make(tmp_path / "kernels", signatures)
    for path in folder.rglob("*.nbc"):
        path.write_bytes(path.read_bytes()[:50])
    before = content(folder)
    done = python(COUNT_COMPILED, GLIDERHPC_KERNELS=folder, GLIDERHPC_CACHE=tmp_path / "cache")
    assert json.loads(done.stdout)[0] > 0
    assert b"are damaged" in done.stderr
    assert content(folder) == before
    assert json.loads(python(COUNT_COMPILED, GLIDERHPC_CACHE=tmp_path / "cache").stdout)[0] == 0


@compiled
@level_known
def test_the_same_sources_give_the_same_bytes(tmp_path: Path, signatures: bytes) -> None:
    assert content(make(tmp_path / "a", signatures)) == content(make(tmp_path / "b", signatures))


@pytest.fixture
def named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder that the variable names, whose manifest fits this process at the level x86-64-v3."""
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
    with pytest.raises(NotUsable, match="every user can write it"):
        find_precompiled()


@pytest.mark.parametrize("text", [None, "{", "[]", "\0"])
def test_a_manifest_that_is_absent_or_damaged_is_said(named: Path, text: str | None) -> None:
    (named / MANIFEST).unlink()
    if text is not None:
        (named / MANIFEST).write_text(text)
    with pytest.raises(NotUsable, match="no compiled kernels"):
        find_precompiled()


def test_numba_set_to_another_processor_uses_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "CPU_NAME", "generic")
    assert host_level() == ""


def test_a_higher_level_has_all_features_of_the_lower() -> None:
    for higher, lower in zip([*LEVELS.values()][:-1], [*LEVELS.values()][1:], strict=True):
        assert set(lower) < set(higher)
