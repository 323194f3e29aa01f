"""Findings shown from an archive, compared with the files of a run and after a changed value."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import Collection
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.findings.results import Findings, write_findings
from gliderhpc.report.studies import show_study


def shown(store: Path, name: str) -> Findings:
    """Show a study from its archive alone."""
    with open_for_reading(store) as archive:
        return show_study(name, archive)


def check_shown_as_left(store: Path, name: str, left: Path, out: Path) -> Findings:
    """Show a study and compare its files, except the figures, which are not drawn, with those of its run."""
    findings = shown(store, name)
    with pytest.MonkeyPatch.context() as patch:
        leave_studies_undrawn(patch)
        written = write_findings(findings, name, out)
    assert {path.name for path in written} == {path.name for path in left.iterdir()}
    for path in written:
        assert path.suffix == ".png" or path.read_bytes() == (left / path.name).read_bytes(), path.name
    assert set(findings.captions) == {*findings.tables, *findings.figures}
    assert all(len(caption.split()) > 10 and "nan" not in caption.split() for caption in findings.captions.values())
    return findings


def shown_after(store: Path, name: str, folder: Path, change: Callable[[Path], None]) -> Findings:
    """Show a study from a copy of its archive after a change to it."""
    copy = folder / f"changed-{store.name}"
    shutil.copytree(store, copy)
    change(copy)
    return shown(copy, name)


def drawn(figure: Figure) -> np.ndarray:
    """All that the lines, points, bars and patches of a figure show, one number after the other."""
    parts = []
    for axes in figure.axes:
        parts += [np.ravel(np.asarray(line.get_xydata(), dtype=np.float64)) for line in axes.lines]
        parts += [part for one in axes.collections for part in _of_collection(one)]
        parts += [np.ravel(patch.get_patch_transform().transform(patch.get_path().vertices)) for patch in axes.patches]
    return np.concatenate(parts)


def _of_collection(one: Collection) -> list[np.ndarray]:
    # The vertices of arrows are those of the page, and change as it is laid out.
    return [one.U, one.V] if isinstance(one, Quiver) else [np.ravel(path.vertices) for path in one.get_paths()]


def check_figure_follows(before: Findings, after: Findings, stem: str) -> None:
    """Check that a figure has changed."""
    assert not np.array_equal(drawn(before.figures[stem]), drawn(after.figures[stem]), equal_nan=True)


def leave_studies_undrawn(patch: pytest.MonkeyPatch) -> None:
    """Make the figures of studies without drawing them, for as long as the patch lasts."""

    def touched(path: Path, figure: Figure) -> Path:
        assert figure.axes
        path.touch()
        return path

    patch.setattr("gliderhpc.findings.results._write_png", touched)
