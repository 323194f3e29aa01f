"""Cache of compiled kernels: found by digest, separate from numba's, shared by all workers, repaired when damaged."""

import json
import os
import sys
from pathlib import Path

import llvmlite.binding
import numba
import pytest
from support.programs import python

from gliderhpc.kernels import cache

compiled = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")

USE_ONE_KERNEL = """
import gliderhpc, numpy as np
gliderhpc.Glider(gliderhpc.platform.read_platform("petrel-l")).bodies(np.zeros((1, 5)))
"""

USED_BY_PROCESSES_IN_TURN = """
import json, os, sys, tempfile
from pathlib import Path
import gliderhpc
import numba
# Imported, and the compiler started, once for all processes, which are forks of this one.
gliderhpc.Glider, gliderhpc.platform.read_platform
numba.njit(lambda x: x)(1.0)

def use():
    with tempfile.TemporaryFile("w+") as said:
        child = os.fork()
        if child == 0:
            os.dup2(said.fileno(), 2)
            try:
                exec(sys.argv[1])
            except BaseException:
                os._exit(1)
            os._exit(0)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        said.seek(0)
        return status, said.read()

used = [("undamaged", *use())]
damages = {"cut": lambda whole: whole[:50], "emptied": lambda _: b"", "replaced": lambda _: bytes((128, 5, 78)) * 99}
for suffix in (".nbi", ".nbc"):
    files = list(Path(os.environ["GLIDERHPC_CACHE"]).rglob(f"*{suffix}"))
    assert files
    for how, damage in damages.items():
        for file in files:
            file.write_bytes(damage(file.read_bytes()))
        used.append((f"{suffix} {how}", *use()))
    used.append(("undamaged", *use()))
print(json.dumps(used))
"""


def test_the_folder_follows_the_kernel_sources(monkeypatch: pytest.MonkeyPatch) -> None:
    before = cache.kernel_digest()
    monkeypatch.setattr(cache.Path, "read_bytes", lambda _: b"another source")
    assert cache.kernel_digest() != before


def test_a_folder_that_cannot_be_written_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("GLIDERHPC_CACHE", str(tmp_path))
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert not cache.choose_folder().is_relative_to(tmp_path)
    assert "cannot be written" in caplog.text


@compiled
def test_functions_of_the_user_are_cached_where_numba_says(tmp_path: Path) -> None:
    """The environment and numba's settings are not changed; only our kernels are in our folder."""
    (tmp_path / "mine.py").write_text(
        "import json, os\n"
        "import numba\n"
        "from numba.core.caching import CacheImpl\n"
        "def settings():\n"
        "    names = [name for name in dir(numba.config) if name.isupper()]\n"
        "    return [dict(os.environ), {n: repr(getattr(numba.config, n)) for n in names},"
        " [*map(repr, CacheImpl._locator_classes)]]\n"
        "before = settings()\n"
        f"{USE_ONE_KERNEL}"
        "@numba.njit(cache=True)\n"
        "def twice(x):\n"
        "    return 2 * x\n"
        "twice(1.0)\n"
        "print(json.dumps([before == settings(), twice.stats.cache_path]))\n"
    )
    done = python(
        "import mine", PYTHONPATH=os.pathsep.join(map(str, (tmp_path, *filter(None, sys.path)))),
        GLIDERHPC_CACHE=tmp_path / "ours", NUMBA_CACHE_DIR=None,
    )  # fmt: skip
    unchanged, place = json.loads(done.stdout)
    assert unchanged
    assert Path(place) == tmp_path / "__pycache__"
    (folder,) = (tmp_path / "ours").iterdir()
    assert folder.name == f"kernels-{cache.kernel_digest()}"
    assert {path.name.partition(".")[0] for path in folder.iterdir()} <= {path.stem for path in cache.SOURCES.iterdir()}
    assert {path.suffix for path in folder.iterdir()} == {".nbi", ".nbc"}


@compiled
def test_locators_that_the_user_set_are_not_asked(tmp_path: Path) -> None:
    python(USE_ONE_KERNEL, GLIDERHPC_CACHE=tmp_path, NUMBA_CACHE_LOCATOR_CLASSES="UserWideCacheLocator")
    assert list(tmp_path.rglob("*.nbi"))


def test_workers_share_the_folder_of_this_process(tmp_path: Path) -> None:
    """They also share the temporary folder of a process whose own folder is refused."""
    script = tmp_path / "script.py"
    script.write_text(
        "from gliderhpc.kernels.cache import compiled_cache\n"
        "from gliderhpc.mission.executors import local_executor\n"
        "if __name__ == '__main__':\n"
        "    with local_executor(1, lambda: None) as executor:\n"
        "        (theirs,) = executor.run(lambda _: str(compiled_cache()), [0])\n"
        "    print(theirs == str(compiled_cache()))\n"
    )
    done = python(
        f"import runpy; runpy.run_path({str(script)!r}, run_name='__main__')", GLIDERHPC_CACHE="not/absolute",
        TMPDIR=tmp_path,
    )  # fmt: skip
    assert done.stdout.strip() == "True"
    assert done.stderr.count("compiled kernels are not stored") == 1
    assert list(tmp_path.iterdir()) == [script]


@compiled
def test_a_full_folder_stops_nothing(tmp_path: Path) -> None:
    """The kernel runs; one message reports that it could not be stored."""
    full = (
        "import errno\n"
        "from numba.core import caching\n"
        "def save(*_):\n"
        "    raise OSError(errno.ENOSPC, 'No space left on device')\n"
        "caching.IndexDataCacheFile.save = save\n"
    )
    done = python(full + USE_ONE_KERNEL, GLIDERHPC_CACHE=tmp_path)
    assert done.returncode == 0
    assert "compiled kernels cannot be stored" in done.stderr
    assert "the next run compiles again" in done.stderr


@pytest.mark.long
@compiled
def test_a_damaged_file_is_compiled_again(tmp_path: Path) -> None:
    """A kernel is used by processes in turn: the first fills its cache, the others find it damaged or repaired."""
    done = python(USED_BY_PROCESSES_IN_TURN, USE_ONE_KERNEL, GLIDERHPC_CACHE=tmp_path)
    used = json.loads(done.stdout)
    assert used.pop(0) == ["undamaged", 0, ""]
    assert len(used) == 8
    for how, status, said in used:
        assert status == 0, how
        assert ("compiling them again" in said) == (how != "undamaged"), how
        assert how != "undamaged" or said == ""


def test_every_kind_of_processor_has_a_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    before = cache.kernel_digest()
    monkeypatch.setattr(llvmlite.binding, "get_host_cpu_name", lambda: "another")
    assert cache.kernel_digest() != before
