"""Pages that `mkdocs build` writes by program: commands, settings, Python reference, modules, performance."""

import ast
import importlib
import inspect
import json
import logging
import pkgutil
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from benchmarks.readme import performance_section
from gliderhpc.cli.main import VERBS, program
from gliderhpc.findings.formatting import markdown

REPOSITORY = Path(__file__).resolve().parents[1]

SUBPACKAGES = (
    "kernels", "flight", "observations", "simulator", "estimation", "mission_hull", "record_checks", "store_schema",
    "archive", "mission", "findings", "studies", "twins", "surfacing", "calibration", "report",
)  # fmt: skip
"""Parts of the package that have a page of the reference each."""

SETTINGS = {
    "A run (`run-mission --set KEY=VALUE`)": ("", "gliderhpc.mission.settings.MissionSettings"),
    "`calibrate`": ("calibration.", "gliderhpc.calibration.settings.CalibrationSettings"),
    "`calibrate`: rounds over the dives": ("rounds.", "gliderhpc.calibration.settings.RoundSettings"),
    "`calibrate`: turn test": ("turn_test.", "gliderhpc.mission_hull.turn_test.TurnTestSettings"),
    "`calibrate`: steady segments": (
        "steady.",
        "gliderhpc.estimation.steady_segments.SegmentSettings",
    ),
    "`tune`": ("tuning.", "gliderhpc.calibration.prior.fit.TuningSettings"),
    "Study `currents`": ("currents.", "gliderhpc.studies.library.retrieval.DepthResolvedSettings"),
    "Study `spectra`": ("spectra.", "gliderhpc.studies.library.turbulence.series.SpectraSettings"),
    "Study `intermittency`": (
        "intermittency.",
        "gliderhpc.studies.library.turbulence.series.IntermittencySettings",
    ),
    "Study `nulls`": ("nulls.", "gliderhpc.studies.nulls.NullSettings"),
    "Study `events`": ("events.", "gliderhpc.studies.events.EventSettings"),
    "Study `drift`": ("drift.", "gliderhpc.studies.library.drift.medians.DriftSettings"),
    "A scenario (`simulate-mission --scenario FILE`)": ("", "gliderhpc.simulator.scenario.Scenario"),
}
"""Settings that have a table: heading, prefix of the keys, and model."""

EXAMPLES = ("slurm.sh", "slurm_workers.py")
"""Files outside the documentation that its pages link to; they come along."""

PERFORMANCE = """# Performance

This page is made from `benchmarks/results.json`, which `make bench` writes; the README shows the same.
[engines.md](engines.md) compares the two engines, [lanes.md](lanes.md) describes the fast one. `run-mission --dry-run`
estimates a mission's time, memory and disk space from the measurements of `python -m benchmarks.planning`.

{section}
"""


def on_config(config: MkDocsConfig) -> None:
    """Keep the libraries that the reference imports from logging into the build."""
    logging.getLogger("numba").setLevel(logging.WARNING)


def on_files(files: Files, *, config: MkDocsConfig) -> None:
    """Add the pages that are written by program, and the examples."""
    pages = {
        "reference/cli.md": commands_page(),
        "reference/settings.md": settings_page(),
        "reference/modules.md": modules_page(),
        "performance.md": performance_page(),
        **{f"reference/{name}.md": subpackage_page(name) for name in SUBPACKAGES},
    }
    for path, content in pages.items():
        files.append(File.generated(config, path, content=content))
    for name in EXAMPLES:
        files.append(File.generated(config, f"examples/{name}", abs_src_path=str(REPOSITORY / "examples" / name)))


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Point links to the examples, which lie next to ``docs`` in the repository, to where they are copied."""
    return markdown.replace("](../examples/", "](examples/")


def performance_page() -> str:
    """Return the page of what `make bench` measured."""
    results = json.loads((REPOSITORY / "benchmarks" / "results.json").read_text("utf-8"))
    return PERFORMANCE.format(section=performance_section(results))


def modules_page() -> str:
    """Return the page of every module of the package with its purpose and size."""
    rows = []
    for path in sorted((REPOSITORY / "gliderhpc").rglob("*.py")):
        text = path.read_text("utf-8")
        purpose = (ast.get_docstring(ast.parse(text)) or "").partition("\n\n")[0].replace("\n", " ")
        if purpose:
            name = ".".join(path.relative_to(REPOSITORY).with_suffix("").parts).removesuffix(".__init__")
            rows.append([f"`{name}`", _escaped(purpose), str(text.count("\n"))])
    heading = [
        "# Modules",
        "",
        f"{len(rows)} modules; [architecture](../architecture.md) describes how they are organised.",
        "",
    ]
    return "\n".join([*heading, markdown(("module", "purpose", "lines"), rows), ""])


# Commands


def commands_page() -> str:
    """Return the page of every verb with its usage, help text and options."""
    parts = ["# Commands", "", "Made from the program itself: `gliderhpc VERB --help` shows the same text.", ""]
    context = click.Context(program, info_name="gliderhpc")
    for verb in VERBS:
        command = program.get_command(context, verb)
        assert command is not None
        parts += _command(command, click.Context(command, info_name=verb, parent=context), 2)
    return "\n".join(parts)


def _command(command: click.Command, context: click.Context, level: int) -> Iterator[str]:
    yield f"{'#' * level} {context.command_path}"
    yield ""
    yield f"```text\n{command.get_usage(context).removeprefix('Usage: ')}\n```"
    yield ""
    yield _help_text(command.help or "")
    yield ""
    options = [row for row in map(_option(context), command.params) if row is not None]
    if options:
        yield markdown(("option", "what it does"), options)
        yield ""
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            assert inner is not None
            yield from _command(inner, click.Context(inner, info_name=name, parent=context), level + 1)


def _option(context: click.Context) -> Any:
    def row(parameter: click.Parameter) -> list[str] | None:
        record = parameter.get_help_record(context)
        return None if record is None or not record[1] else [f"`{record[0]}`", _escaped(record[1])]

    return row


def _help_text(text: str) -> str:
    """Help text with its examples, which click marks by a bell, as blocks of code."""
    paragraphs = re.split(r"\n\s*\n", inspect.cleandoc(text))
    return "\n\n".join(_paragraph(paragraph) for paragraph in paragraphs)


def _paragraph(paragraph: str) -> str:
    if not paragraph.startswith("\b"):
        return _escaped(paragraph)
    heading, _, lines = paragraph.removeprefix("\b").strip().partition("\n")
    return f"{heading}\n\n```text\n{textwrap.dedent(lines)}\n```"


def _escaped(text: str) -> str:
    return text.replace("<", "&lt;").replace("[", "\\[")


# Settings


def settings_page() -> str:
    """Return the page of every setting with its default, limits and meaning."""
    parts = [
        "# Settings",
        "",
        "Made from the models that validate them. A value is set by `--set KEY=VALUE`, in YAML; `null` stands for one",
        "that is derived or omitted. The settings of a run are in its archive's root attributes, those of a study in",
        "its group's.",
        "",
    ]
    for heading, (prefix, path) in SETTINGS.items():
        rows = list(_rows(_model(path), prefix))
        parts += [f"## {heading}", "", markdown(("key", "default", "meaning"), rows), ""]
    return "\n".join(parts)


def _model(path: str) -> type[BaseModel]:
    module, _, name = path.rpartition(".")
    model: type[BaseModel] = getattr(importlib.import_module(module), name)
    return model


def _rows(model: type[BaseModel], prefix: str) -> Iterator[list[str]]:
    for name, field in model.model_fields.items():
        annotation = field.annotation
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            yield from _rows(annotation, f"{prefix}{name}.")
        else:
            yield [f"`{prefix}{name}`", f"`{_default(field)}`", _meaning(field)]


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    default = field.get_default(call_default_factory=True)
    return json.dumps(default, default=str).strip('"')


def _meaning(field: FieldInfo) -> str:
    limits = ", ".join(
        f"{sign} {getattr(bound, name):g}"
        for bound in field.metadata
        for name, sign in (("gt", "above"), ("ge", "at least"), ("lt", "below"), ("le", "at most"))
        if getattr(bound, name, None) is not None
    )
    return _escaped(field.description or "") + (f" ({limits})" if limits else "")


# Python


def subpackage_page(name: str) -> str:
    """Return the page of every public module of a part of the package, by its docstrings."""
    package = importlib.import_module(f"gliderhpc.{name}")
    modules = sorted(
        module.name
        for module in pkgutil.walk_packages(package.__path__, f"gliderhpc.{name}.")
        # To Python the library of Fortran kernels looks like a module.
        if not any(part.startswith(("_", "libgliderhpc")) for part in module.name.split("."))
    )
    head = f"# {name.replace('_', ' ').capitalize()}\n"
    return head + "".join(f"\n::: {module}\n" for module in [f"gliderhpc.{name}", *modules])
