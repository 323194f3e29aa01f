"""Notebooks: their cells run from top to bottom, and they are stored without outputs."""

import ast
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.repository import REPOSITORY

# The Python interface, by which the notebooks are written.

pytestmark = pytest.mark.compiled

NOTEBOOKS = REPOSITORY / "notebooks"
MAP_LINES = 10
"""Most lines of code of the notebook with the map of currents."""
FIRST_LINES = 8
"""Most lines of code from the import to the figure of a real dive."""


def code_cells(name: str) -> list[str]:
    """Texts of a notebook's code cells."""
    cells = json.loads((NOTEBOOKS / name).read_text("utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


def execute(name: str) -> dict[str, Any]:
    """Run the code cells of a notebook in the current folder; its names are returned."""
    names: dict[str, Any] = {}
    for number, cell in enumerate(code_cells(name), 1):
        exec(compile(cell, f"{name}, cell {number}", "exec"), names)
    return names


@pytest.mark.long
def test_a_real_dive(shared_data, monkeypatch):
    monkeypatch.chdir(NOTEBOOKS)
    found = execute("real_mission.ipynb")
    assert str(found["dive"].ds.status.values[0]) == "done"
    assert found["figure"].axes
    assert bool(found["usable"].any())


@pytest.mark.long
def test_a_synthetic_mission(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = execute("synthetic_mission.ipynb")
    assert (found["currents"]["status"] == "done").all()
    assert found["findings"].tables
    assert found["figure"].axes
    assert float(np.hypot(found["north"], found["east"]).max()) < 0.1


@pytest.mark.long
def test_a_map_of_currents_of_a_pyglider_file(shared_data, monkeypatch):
    monkeypatch.chdir(NOTEBOOKS)
    found = execute("currents_map.ipynb")
    assert np.isfinite(found["found"]["dac_north"].values).all()
    assert found["figure"].axes


@pytest.mark.long
def test_few_lines_lead_to_the_map_of_currents():
    lines = [line for cell in code_cells("currents_map.ipynb") for line in cell.splitlines() if line.strip()]
    assert len(lines) <= MAP_LINES


@pytest.mark.long
def test_few_lines_lead_to_the_figure_of_a_real_dive():
    lines = [line for line in code_cells("real_mission.ipynb")[0].splitlines() if line.strip()]
    assert len(lines) <= FIRST_LINES


@pytest.mark.long
@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.name)
def test_no_outputs_are_stored(path: Path):
    cells = json.loads(path.read_text("utf-8"))["cells"]
    assert all(not cell["outputs"] and cell["execution_count"] is None for cell in cells if cell["cell_type"] == "code")
    for text in code_cells(path.name):
        ast.parse(text)
