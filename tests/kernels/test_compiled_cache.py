"""The cache of compiled kernels: found by digest, and made anew when a file in it is damaged."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from gliderhpc import _compiled_cache


def test_the_folder_follows_the_kernel_sources(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    before = _compiled_cache.kernel_digest()
    monkeypatch.setattr(_compiled_cache.Path, "read_bytes", lambda _: b"another source")
    assert _compiled_cache.kernel_digest() != before


def test_a_folder_the_user_chose_is_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    _compiled_cache.use_compiled_cache()
    assert os.environ["NUMBA_CACHE_DIR"] == str(tmp_path)


def test_clearing_takes_our_kernels_alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    ours, theirs = tmp_path / "kernels_abc" / "window.nbc", tmp_path / "others_abc" / "x.nbc"
    for file in (ours, theirs):
        file.parent.mkdir()
        file.write_bytes(b"x")
    assert _compiled_cache.clear_compiled_cache() == tmp_path
    assert not ours.exists()
    assert theirs.exists()


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_a_damaged_cache_is_compiled_anew(tmp_path: Path) -> None:
    """Two processes: one fills the cache of a single kernel, the other finds it truncated and recovers."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    use = (
        "import gliderhpc, numpy as np\n"
        "from gliderhpc.kernels.mass import bodies_of_controls\n"
        "from gliderhpc.mission import warm\n"
        "glider = gliderhpc.Glider(gliderhpc.platform.read_platform('petrel-l'))\n"
        "warm.estimate_a_few_seconds = lambda engine: glider.bodies(np.zeros((1, 5)))\n"
        "warm.warm_kernels()\n"
    )
    subprocess.run([sys.executable, "-c", use], env=environment, check=True)
    files = list(tmp_path.rglob("*.nbi"))
    assert files
    for file in files:
        file.write_bytes(file.read_bytes()[:50])
    again = subprocess.run([sys.executable, "-c", use], env=environment, check=True, capture_output=True, text=True)
    assert "compiling them again" in again.stderr
