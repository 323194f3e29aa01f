"""What the twin studies leave in a folder: CSV, JSON, PNG, budget, and the tables that are printed."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from gliderhpc.analysis.study_output import Comparison, comparisons_as_json, write_csv, write_json
from gliderhpc.analysis.twin.budget import write_budget
from gliderhpc.analysis.twin.recoverability import PRESETS as RECOVERED_PRESETS
from gliderhpc.analysis.twin.recoverability import RecoverabilityStudy, compare_recoverability
from gliderhpc.analysis.twin.sensitivity import SensitivityStudy, compare_sensitivity
from gliderhpc.analysis.twin.windows import PRESETS, WindowsStudy, compare_windows, verdict_sentence
from gliderhpc.platform import Platform
from gliderhpc.report.twin_figures import (
    write_recoverability_figure,
    write_sensitivity_figure,
    write_windows_figure,
)
from gliderhpc.version import __version__

Tables = dict[str, list[Comparison]]


def about(study: str, platforms: Sequence[Platform], size: Any, seeds: Sequence[int], quick: bool) -> dict[str, Any]:
    """Say what a JSON came from."""
    return {
        "study": study,
        "version": __version__,
        "quick": quick,
        "platforms": [platform.name for platform in platforms],
        "seeds": list(seeds),
        "size": asdict(size),
    }


def write_windows(study: WindowsStudy, out: Path, header: Mapping[str, Any]) -> Tables:
    """Write ``windows.csv``, ``.json`` and ``.png``; give the tables, one a hull and preset."""
    tables = {
        f"{hull}, {preset}": compare_windows(study, hull, preset) for hull in header["platforms"] for preset in PRESETS
    }
    sentences = [verdict_sentence(line) for line in study.verdicts]
    content = {"verdicts": study.verdicts, "sentences": sentences, "summary": study.summary}
    _write(out / "windows", header, tables, study.rows, content)
    write_windows_figure(study, out / "windows.png")
    return tables


def write_sensitivity(study: SensitivityStudy, out: Path, header: Mapping[str, Any]) -> Tables:
    """Write ``sensitivity.csv``, ``.json`` and ``.png``; give the tables, one a preset."""
    presets = dict.fromkeys(line["preset"] for line in study.summary)
    tables = {f"{header['platforms'][0]}, {preset}": compare_sensitivity(study, preset) for preset in presets}
    _write(out / "sensitivity", header, tables, study.rows, {"summary": study.summary, "biases": study.biases})
    write_sensitivity_figure(study, out / "sensitivity.png")
    return tables


def write_recoverability(study: RecoverabilityStudy, out: Path, header: Mapping[str, Any]) -> Tables:
    """Write ``recoverability.csv``, ``.json`` and ``.png``, and ``budget.yaml``; give the tables, one a preset."""
    tables = {
        f"{header['platforms'][0]}, {preset}": compare_recoverability(study, preset) for preset in RECOVERED_PRESETS
    }
    content = {
        "noise": study.noise, "detection": study.detection, "floors": study.floors, "errors": study.errors,
        "budget": _dumped(study.budget),
    }  # fmt: skip
    _write(out / "recoverability", header, tables, [*study.findings, *study.motions], content)
    write_recoverability_figure(study, out / "recoverability.png")
    write_budget(out / "budget.yaml", study.budget)
    return tables


def _write(
    stem: Path, header: Mapping[str, Any], tables: Tables, rows: Sequence[Mapping[str, Any]], content: Mapping[str, Any]
) -> None:
    write_csv(stem.with_suffix(".csv"), rows)
    compared = {title: comparisons_as_json(table) for title, table in tables.items()}
    write_json(stem.with_suffix(".json"), {**header, "comparisons": compared, **content})


def _dumped(model: BaseModel) -> dict[str, Any]:
    return model.model_dump()
