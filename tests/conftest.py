"""Fixtures shared by the whole suite."""

from pathlib import Path

import pytest

import gliderhpc  # noqa: F401 - it names numba's cache folder, so it comes before a test module that imports numba

REPOSITORY = Path(__file__).resolve().parents[1]


def _shared(name: str) -> Path:
    folder = REPOSITORY.parent / "shared" / name
    if not folder.is_dir():
        pytest.skip(f"{folder.name} is not beside this checkout")
    return folder


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real glider files beside the checkout; the test is skipped where it is absent."""
    return _shared("data")


@pytest.fixture(scope="session")
def oracle() -> Path:
    """Folder of values from independent automatic differentiation."""
    return _shared("oracle")
