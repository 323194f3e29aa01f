"""Recipes as files and commands: every kind prepares a folder, runs its commands and checks the outcome."""

from __future__ import annotations

import errno
import os
import re
import shutil
import subprocess
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.fuzzing import archive_edits, byte_edits, netcdf_edits, verdicts
from benchmarks.fuzzing.program import Call, Ended, Program
from benchmarks.fuzzing.specimens import BUDGET, HULL, SCENARIO, Specimens, run_mission
from benchmarks.fuzzing.verdicts import Fault

Recipe = dict[str, Any]

BYSTANDERS = ("mission.zarr.old", "mission.zarr.partial", "out.nc.partial", "out.old")
"""Files of a user next to the outputs, named as a careless program names its own."""

NOBODY = 65534


class SkippedError(Exception):
    """The recipe has no meaning here."""


@dataclass
class Case:
    """A folder with inputs, what ran in it, and what was broken."""

    program: Program
    specimens: Specimens
    folder: Path
    faults: list[Fault] = field(default_factory=list)
    transcript: list[dict[str, Any]] = field(default_factory=list)

    def run(self, *arguments: object, outputs: tuple[str, ...] = (), streams: str = "files", **more: Any) -> Ended:
        """Run a command and check the invariants; `outputs` are what it may write."""
        before = verdicts.snapshot(self.folder)
        words = tuple(map(str, arguments))
        ended = self.program.run(Call(words, self.folder, streams=streams, **more))
        self.faults += verdicts.ended_well(ended, self.program.memory)
        if not ended.hung:
            after = verdicts.snapshot(self.folder)
            found = verdicts.changes(before, after, outputs, ended.status)
            # Whoever is killed outright cannot tidy up.
            self.faults += [fault for fault in found if ended.status >= 0 or not fault.detail.endswith("left behind")]
        self.transcript.append(
            {"arguments": words, "status": ended.status, "seconds": round(ended.seconds, 2), "text": ended.text[-4000:]}
        )
        return ended

    def copy(self, source: Path, name: str | None = None) -> Path:
        """Copy a specimen, file or folder, into the case."""
        target = self.folder / (name or source.name)
        if source.is_dir():
            shutil.copytree(source, target, symlinks=True)
        else:
            shutil.copy(source, target)
        return target

    def add_bystanders(self) -> None:
        """Put files of a user's next to where the outputs go."""
        for name in BYSTANDERS:
            (self.folder / name).mkdir()
            (self.folder / name / "mine.txt").write_text("not yours\n", "utf-8")


def judge(recipe: Recipe, program: Program, specimens: Specimens, folder: Path) -> Case:
    """Run a recipe in a folder of its own, which is removed afterwards."""
    case = Case(program, specimens, folder)
    folder.mkdir(parents=True)
    try:
        RUN[recipe["kind"]](case, recipe)
    finally:
        _remove(folder)
    case.faults = list(dict.fromkeys(case.faults))
    return case


def _remove(folder: Path) -> None:
    for root, names, _ in os.walk(folder):
        for name in names:
            path = Path(root, name)
            if not path.is_symlink():
                path.chmod(0o755)
    shutil.rmtree(folder, ignore_errors=True)


# Observation files and instruments


LIES = [
    ["scale", "ballast_volume", 1e-6], ["scale", "pitch", 0.0174533], ["scale", "heading", 0.0174533],
    ["shift", "fix_latitude", 27.0], ["shift", "fix_longitude", 27.0],
]  # fmt: skip
"""Edits of a valid record that must not pass without a message."""


def _spoil_netcdf(path: Path, recipe: Recipe) -> bool:
    """Edit a file; tells whether what was done is a lie that has to be noticed."""
    failed = netcdf_edits.edited(path, recipe["edits"])
    if len(failed) == len(recipe["edits"]) and not recipe["bytes"]:
        raise SkippedError(failed[0])
    byte_edits.edited(path, recipe["bytes"])
    lie = len(recipe["edits"]) == 1 and recipe["edits"][0][:3] in LIES
    if lie and recipe["edits"][0][0] == "shift":
        lie = 0.2 < recipe["edits"][0][3] < 0.8
    return recipe.get("lie", lie and not recipe["bytes"] and not failed)


def run_observations(case: Case, recipe: Recipe) -> None:
    """Feed an edited observation file to a command that reads one."""
    records = case.copy(case.specimens.observations(), "in.nc")
    lied = _spoil_netcdf(records, recipe)
    command = recipe["command"]
    common = ("in.nc", "--platform", HULL)
    if command == "append":
        store = case.copy(case.specimens.short_archive(), "mission.zarr")
        ended = case.run(*run_mission("in.nc", "mission.zarr", "--append"), outputs=("mission.zarr",))
        case.faults += verdicts.archive_nonsense(store, ended.text, False)
        return
    case.add_bystanders()
    if command == "dry-run":
        planned = case.run(*run_mission("in.nc", "mission.zarr", "--dry-run"))
        ran = case.run(*run_mission("in.nc", "mission.zarr"), outputs=("mission.zarr",))
        if planned.status == 0 and ran.status == 2:
            case.faults.append(Fault("wrong", "--dry-run plans a run that is refused"))
    elif command == "run":
        ended = case.run(*run_mission("in.nc", "mission.zarr"), outputs=("mission.zarr",))
        case.faults += verdicts.archive_nonsense(case.folder / "mission.zarr", ended.text, lied)
        _expect_status(case, recipe, ended)
    elif command == "inspect":
        case.run("inspect", *common, "--out", "checks.json", outputs=("checks.json",))
    elif command == "tune":
        case.run("tune", *common, "--out", "hull.yaml", "--set", "tuning.longest=60", outputs=("hull.yaml",))
    else:
        case.run("calibrate", *common, "--out", "hull.yaml", outputs=("hull.yaml",))


def _import(case: Case, recipe: Recipe, *arguments: object) -> None:
    case.add_bystanders()
    ended = case.run("import", *arguments, "out.nc", outputs=("out.nc",))
    if ended.status in (0, 1):
        case.faults += verdicts.observation_nonsense(case.folder / "out.nc", ended.text)
    _expect_status(case, recipe, ended)


def _expect_status(case: Case, recipe: Recipe, ended: Ended) -> None:
    """Hold the status against those that a recipe of the corpus asks for."""
    if ended.status not in recipe.get("statuses", [ended.status]) and not ended.hung:
        case.faults.append(Fault("wrong", f"status {ended.status}, not one of {recipe['statuses']}"))


def run_seaexplorer(case: Case, recipe: Recipe) -> None:
    """Import an edited SeaExplorer mission."""
    folder = case.copy(case.specimens.seaexplorer(), "in")
    files = sorted(folder.iterdir())
    path = files[recipe["which"] % len(files)]
    byte_edits.edited(path, recipe["edits"])
    if recipe["packed"] and path.is_file() and not path.is_symlink():
        byte_edits.edited(path, [["gzip"]])
        path = path.rename(path.with_name(path.name + ".gz"))
    byte_edits.edited(path, recipe["bytes"])
    _import(case, recipe, "seaexplorer", "in")


def run_slocum(case: Case, recipe: Recipe) -> None:
    """Import an edited pair of Slocum's binary files."""
    folder = case.copy(case.specimens.slocum(), "in")
    files = sorted(folder.iterdir())
    path = files[recipe["which"] % len(files)]
    for edit in recipe["edits"]:
        if edit[0] in ("tag", "sensor"):
            _edit_header(path, *edit)
        else:
            byte_edits.edited(path, [edit])
    byte_edits.edited(path, recipe["bytes"])
    _import(case, recipe, "slocum", "in")


def _edit_header(path: Path, what: str, which: str | int, *rest: Any) -> None:
    """Replace a tag's value, or one field of a sensor's line."""
    if not path.is_file():
        return
    lines = path.read_bytes().split(b"\n")
    if what == "tag":
        places = [i for i, line in enumerate(lines) if line.startswith(f"{which}:".encode())]
        for place in places:
            lines[place] = f"{which}:    {rest[0]}".encode("utf-8", "surrogatepass")
    else:
        places = [i for i, line in enumerate(lines) if line.startswith(b"s: ")]
        if places:
            place = places[int(which) % len(places)]
            fields = lines[place].split()
            fields[rest[0] % len(fields)] = str(rest[1]).encode("utf-8", "surrogatepass")
            lines[place] = b" ".join(fields)
    path.write_bytes(b"\n".join(lines))


def run_slocum_netcdf(case: Case, recipe: Recipe) -> None:
    """Import an edited file of native sensors."""
    _spoil_netcdf(case.copy(case.specimens.slocum_netcdf(), "in.nc"), recipe)
    _import(case, recipe, "slocum", "in.nc")


def run_seaglider(case: Case, recipe: Recipe) -> None:
    """Import a Seaglider mission with one edited dive."""
    folder = case.copy(case.specimens.seaglider(), "in")
    files = sorted(folder.iterdir())
    _spoil_netcdf(files[recipe["which"] % len(files)], recipe)
    _import(case, recipe, "seaglider", "in")


def run_og1(case: Case, recipe: Recipe) -> None:
    """Import an edited OG1 file."""
    _spoil_netcdf(case.copy(case.specimens.og1(), "in.nc"), recipe)
    _import(case, recipe, "og1", "in.nc")


# YAML


def run_yaml(case: Case, recipe: Recipe) -> None:
    """Read an edited platform, scenario or budget."""
    path, command = case.folder / "in.yaml", recipe["command"]
    if command == "simulate":
        path.write_text(SCENARIO + "sensors: {depth_noise: 0.03}\n", "utf-8")
    elif command == "budget":
        path.write_text(BUDGET, "utf-8")
    else:
        shutil.copy(case.specimens.platform(), path)
    sound = path.read_bytes()
    doubled = False
    for edit in recipe["edits"]:
        doubled |= edit[0] == "twice"
        _edit_yaml(path, edit)
    if path.read_bytes() == sound and not recipe["bytes"]:
        raise SkippedError("nothing was changed")
    byte_edits.edited(path, recipe["bytes"])
    ended = _read_yaml(case, command)
    _expect_status(case, recipe, ended)
    if doubled and len(recipe["edits"]) == 1 and not recipe["bytes"] and ended.status == 0:
        case.faults.append(Fault("wrong", f"a key given twice passes in {command}"))
    if command == "platforms" and ended.status == 0 and re.search(r"\b[+-]?(nan|inf)\b", ended.text):
        case.faults.append(Fault("wrong", "a hull's table holds nan or inf"))


def _read_yaml(case: Case, command: str) -> Ended:
    if command == "platforms":
        return case.run("platforms", "in.yaml")
    if command == "dry-run":
        records = case.copy(case.specimens.observations(), "in.nc")
        return case.run("run-mission", records.name, "--platform", "in.yaml", "--store", "mission.zarr", "--dry-run")
    if command == "simulate":
        arguments = ("--platform", HULL, "--scenario", "in.yaml", "--profiles", 1, "--workers", 0)
        return case.run("simulate-mission", "out.nc", *arguments, outputs=("out.nc", "out.truth.nc"))
    case.copy(case.specimens.archive(), "mission.zarr")
    arguments = ("mission.zarr", "currents", "--budget", "in.yaml", "--workers", 0, "--out", "study")
    return case.run("analyze", *arguments, outputs=("mission.zarr", "study"))


def _edit_yaml(path: Path, edit: list[Any]) -> None:
    """Edit a YAML file as text: values by their place in it, so that what no YAML writer writes can be written."""
    if edit[0] not in ("value", "twice", "key", "bomb"):
        byte_edits.edited(path, [edit])
        return
    text = path.read_text("utf-8", "surrogateescape")
    if edit[0] == "bomb":
        levels = [f"a{i + 1}: &a{i + 1} [{', '.join([f'*a{i}'] * 9)}]" for i in range(edit[1])]
        text = "\n".join(["a0: &a0 [x]", *levels, text])
    else:
        pattern = r"(?m)(?<![\w'])(\w+):[ ]*([^\s,{}\[\]][^,{}\[\]\n]*|\[[^\]]*\])?"
        found = list(re.finditer(pattern, text))
        if not found:
            return
        match = found[edit[1] % len(found)]
        if edit[0] == "value":
            text = text[: match.start()] + f"{match[1]}: {edit[2]}" + text[match.end() :]
        elif edit[0] == "key":
            text = text[: match.start()] + edit[2] + text[match.start() + len(match[1]) :]
        elif match[2] is not None and not match[2].startswith(">"):
            end = "\n" if text[: match.start()].endswith("\n") or match.start() == 0 else ", "
            text = text[: match.start()] + match[0] + end + text[match.start() :]
    path.write_text(text, "utf-8", "surrogateescape")


# Command lines


def run_command_line(case: Case, recipe: Recipe) -> None:
    """Run a command with an unusual number, range or setting."""
    word, setting, template = recipe["word"], recipe["setting"], recipe["template"]
    try:
        os.fsencode(word)
    except UnicodeEncodeError:
        raise SkippedError("no command line can hold this") from None
    ended = _run_template(case, template, word, f"{setting}={word}", recipe)
    _expect_status(case, recipe, ended)
    numeric = template in ("import-scale", "import-zero", "import-declination", "import-battery", "platforms-depth")
    if numeric and ended.status == 0 and word.strip().lower() in ("nan", "inf", "-inf", "1e400", "1e999"):
        case.faults.append(Fault("wrong", f"{template}: not a finite number and taken"))


def _run_template(case: Case, template: str, word: str, assignment: str, recipe: Recipe) -> Ended:
    verb, what = template.split("-", 1) if "-" in template else (template, "")
    if verb in ("run", "tune", "calibrate", "inspect"):
        case.copy(case.specimens.observations(), "in.nc")
    if verb in ("info", "report", "export", "analyze"):
        case.copy(case.specimens.archive(), "mission.zarr")
    dry = (*run_mission("in.nc", "mission.zarr"), "--dry-run")
    fit = ("in.nc", "--platform", HULL, "--out", "hull.yaml")
    simulate = ("simulate-mission", "out.nc", "--platform", HULL, "--profiles", 1)
    if verb == "import":
        which = {"scale": ("seaexplorer", "--linear-scale"), "zero": ("seaexplorer", "--linear-zero"),
                 "declination": ("og1", "--declination"), "battery": ("slocum", "--battery-scale")}[what]  # fmt: skip
        source = {"seaexplorer": case.specimens.seaexplorer, "og1": case.specimens.og1,
                  "slocum": case.specimens.slocum_netcdf}[which[0]]()  # fmt: skip
        records = case.copy(source, "in" if source.is_dir() else "in.nc")
        return case.run("import", which[0], records.name, "out.nc", f"{which[1]}={word}", outputs=("out.nc",))
    calls: dict[str, tuple[tuple[object, ...], tuple[str, ...]]] = {
        "run-profiles": ((*dry, f"--profiles={recipe['range']}"), ()),
        "run-set": ((*dry, "--set", assignment), ()),
        "run-workers": ((*dry, f"--workers={word}"), ()),
        "run-platform": (("run-mission", "in.nc", f"--platform={word}", "--store", "mission.zarr", "--dry-run"), ()),
        "simulate-depth": ((*simulate, "--scenario", "calm", f"--depth={word}"), ("out.nc", "out.truth.nc")),
        "simulate-seed": ((*simulate, "--depth", 15, f"--seed={word}"), ("out.nc", "out.truth.nc")),
        "simulate-profiles": (("simulate-mission", "out.nc", "--platform", HULL, "--depth=x", f"--profiles={word}"), ()),
        "platforms-mass": (("platforms", HULL, f"--net-mass={word}"), ()),
        "platforms-pitch": (("platforms", HULL, f"--pitch={word}"), ()),
        "platforms-depth": (("platforms", HULL, f"--depth={word}"), ()),
        "info-set": (("info", "mission.zarr", word), ()),
        "report-profile": (("report", "mission.zarr", "--out", "page", f"--profile={word}"), ("page",)),
        "export-attribute": (("export", "og1", "mission.zarr", "out.nc", f"--attribute=comment={word}"), ("out.nc",)),
        "analyze-set": (
            ("analyze", "mission.zarr", "currents", "--workers", 0, "--out", "study", f"--set=currents.bin={word}"),
            ("mission.zarr", "study"),
        ),
        "analyze-profiles": (
            ("analyze", "mission.zarr", "drift", "--workers", 0, "--out", "study", f"--profiles={recipe['range']}"),
            ("mission.zarr", "study"),
        ),
        "tune-set": (("tune", *fit, "--profiles=1", "--set", "tuning.longest=30", f"--set={assignment}"), ("hull.yaml",)),
        "calibrate-set": (("calibrate", *fit, f"--set={assignment}"), ("hull.yaml",)),
        "calibrate-hold": (("calibrate", *fit, f"--hold-out={recipe['range']}"), ("hull.yaml",)),
        "inspect-set": (("inspect", "in.nc", "--platform", HULL, f"--set={assignment}"), ()),
        "twin-seeds": (("twin", "windows", "--out", "twins", "--platform", f"{word}x"), ("twins",)),
    }  # fmt: skip
    if template == "any":
        return case.run(*[word, *recipe["more"]])
    arguments, outputs = calls[template]
    return case.run(*arguments, outputs=outputs)


# Archives


READING: dict[str, tuple[tuple[object, ...], tuple[str, ...]]] = {
    "info": (("info", "mission.zarr"), ()),
    "check": (("check", "mission.zarr"), ()),
    "deep": (("check", "mission.zarr", "--deep"), ()),
    "compare": (("compare", "mission.zarr", "sound.zarr"), ()),
    "compare-reversed": (("compare", "sound.zarr", "mission.zarr"), ()),
    "report": (("report", "mission.zarr", "--out", "page"), ("page",)),
    "report-profile": (("report", "mission.zarr", "--out", "page", "--profile", 2), ("page",)),
    "og1": (("export", "og1", "mission.zarr", "out.nc"), ("out.nc",)),
    "currents": (("export", "currents", "mission.zarr", "out.nc"), ("out.nc",)),
    "validate": (
        ("validate", "swift.nc", "--platform", HULL, "--store", "mission.zarr", "--workers", 0, "--out", "study"),
        ("mission.zarr", "study"),
    ),
    **{
        f"analyze-{study}": (
            ("analyze", "mission.zarr", study, "--workers", 0, "--out", "study"), ("mission.zarr", "study"),
        )
        for study in ("reconstruction", "drift", "currents", "vertical")
    },
    "resume": (run_mission("swift.nc", "mission.zarr", "--resume"), ("mission.zarr",)),
    "append": (run_mission("swift.nc", "mission.zarr", "--append"), ("mission.zarr",)),
    "overwrite": (run_mission("swift.nc", "mission.zarr", "--overwrite"), ("mission.zarr",)),
}  # fmt: skip
"""Commands on an archive, and the files that they may write."""


def run_archive(case: Case, recipe: Recipe) -> None:
    """Damage an archive and run a command on it."""
    case.copy(case.specimens.observations(), "swift.nc")
    sound = case.specimens.archive()
    store = case.copy(sound, "mission.zarr")
    command = recipe["command"]
    if command.startswith("compare"):
        case.copy(sound, "sound.zarr")
    damaged = archive_edits.damaged(store, recipe["edits"])
    arguments, outputs = READING[command]
    ended = case.run(*arguments, outputs=outputs)
    _expect_status(case, recipe, ended)
    if command in ("resume", "append", "overwrite") and ended.status == 0:
        _expect_equal(case, sound, command)
    if command in ("og1", "currents") and ended.status == 0:
        _expect_same_export(case, command)
    chunks = archive_edits.files_of(sound, archive_edits.CHUNK)
    lacks = any(sound / name in chunks and not (store / name).exists() for name in damaged)
    if command in ("info", "check", "deep") and ended.status == 0 and lacks:
        case.faults.append(Fault("wrong", f"{command} passes an archive that lacks a chunk"))


def _expect_equal(case: Case, sound: Path, command: str) -> None:
    """Compare a repaired archive with its digests and with the intact one."""
    case.copy(sound, "sound.zarr")
    for check in (("check", "mission.zarr", "--deep"), ("compare", "mission.zarr", "sound.zarr")):
        ended = case.program.run(Call(check, case.folder))
        # After --overwrite the studies are gone, which compare does not count; a run mends no study, but names it.
        if ended.status != 0 and not (check[0] == "check" and _is_of_studies_alone(ended.text)):
            tail = " / ".join(ended.text.splitlines()[-2:])
            case.transcript.append({"arguments": check, "status": ended.status, "text": ended.text[-2000:]})
            case.faults.append(Fault("wrong", f"--{command} ended with 0 and {check[0]} does not: {_plain(tail)}"))


def _is_of_studies_alone(text: str) -> bool:
    """Return whether every difference that `check` lists is mended by running a study again."""
    listed = [line for line in text.splitlines() if not re.search(r"\d+ differences?$", line)]
    return bool(listed) and all(re.search(r"run \w+ again$", line) for line in listed)


def _plain(text: str) -> str:
    return re.sub(r"\d+", "N", text)[:100]


def _expect_same_export(case: Case, command: str) -> None:
    """Compare the export of a damaged archive with that of the intact one."""
    folder = case.specimens.folder / f"exported-{command}"
    if not (folder / "out.nc").is_file():
        folder.mkdir(exist_ok=True)
        case.program.run(Call(("export", command, str(case.specimens.archive()), "out.nc"), folder))
    if not verdicts.same_netcdf(folder / "out.nc", case.folder / "out.nc"):
        case.faults.append(Fault("wrong", f"export {command} of a damaged archive differs and ends with 0"))


# Permissions, streams, places, disks


def _prepare(case: Case, command: str) -> tuple[tuple[object, ...], str | None, str | None]:
    """Lay out the inputs of a command: its arguments, its input and its output."""
    if command in ("run", "dry-run", "inspect", "tune"):
        case.copy(case.specimens.observations(), "in.nc")
        return {
            "run": (run_mission("in.nc", "mission.zarr"), "in.nc", "mission.zarr"),
            "dry-run": (run_mission("in.nc", "mission.zarr", "--dry-run"), "in.nc", None),
            "inspect": (("inspect", "in.nc", "--platform", HULL, "--out", "out.json"), "in.nc", "out.json"),
            "tune": (
                ("tune", "in.nc", "--platform", HULL, "--profiles", "1", "--set", "tuning.longest=30", "--out", "out.yaml"),
                "in.nc", "out.yaml",
            ),
        }[command]  # fmt: skip
    if command in ("info", "check", "compare", "report", "og1", "reconstruction"):
        case.copy(case.specimens.archive(), "in.zarr")
        return {
            "info": (("info", "in.zarr"), "in.zarr", None),
            "check": (("check", "in.zarr", "--deep"), "in.zarr", None),
            "compare": (("compare", "in.zarr", "in.zarr"), "in.zarr", None),
            "report": (("report", "in.zarr", "--out", "page"), "in.zarr", "page"),
            "og1": (("export", "og1", "in.zarr", "out.nc"), "in.zarr", "out.nc"),
            "reconstruction": (
                ("analyze", "in.zarr", "reconstruction", "--workers", 0, "--out", "study"), "in.zarr", "study"
            ),
        }[command]  # fmt: skip
    if command.startswith("import"):
        name = command.split("-")[1]
        case.copy(getattr(case.specimens, name)(), "in")
        return ("import", name, "in", "out.nc"), "in", "out.nc"
    if command == "simulate":
        (case.folder / "in.yaml").write_text(SCENARIO, "utf-8")
        arguments = ("--platform", HULL, "--scenario", "in.yaml", "--profiles", 1, "--workers", 0)
        return ("simulate-mission", "out.nc", *arguments), "in.yaml", "out.nc"
    if command == "platforms":
        case.copy(case.specimens.platform(), "in.yaml")
        return ("platforms", "in.yaml"), "in.yaml", None
    return ("doctor",), None, None


def _outputs(command: str, output: str | None) -> tuple[str, ...]:
    named = (output,) if output else ()
    return (*named, "out.truth.nc", "run.log", "in.zarr") if command == "reconstruction" else (
        *named, "out.truth.nc", "run.log"
    )  # fmt: skip


def run_permissions(case: Case, recipe: Recipe) -> None:
    """Run a command as another user, who may not read an input or not write where the output goes."""
    if os.getuid() != 0:
        raise SkippedError("only an administrator can become another user")
    arguments, source, output = _prepare(case, recipe["command"])
    for path in (case.folder, *case.folder.rglob("*")):
        os.lchown(path, NOBODY, NOBODY)
    target = _forbidden(case, recipe, source, output)
    if target is None:
        raise SkippedError("the command has no such file")
    target.chmod(recipe["mode"])
    os.lchown(target, 0, 0)
    case.run(*arguments, outputs=_outputs(recipe["command"], output), user=NOBODY)


def _forbidden(case: Case, recipe: Recipe, source: str | None, output: str | None) -> Path | None:
    what = recipe["what"]
    if what == "folder":
        # Without the right to enter the folder that it runs in, no program starts.
        return case.folder if recipe["mode"] in (0o111, 0o555) else None
    if what == "input":
        return case.folder / source if source else None
    if what == "output" and output:
        path = case.folder / output
        path.touch() if path.suffix in (".nc", ".json", ".yaml") else path.mkdir()
        return path
    if what.startswith("archive") and source == "in.zarr":
        inside = sorted((case.folder / source).rglob("*"))
        chosen = [path for path in inside if path.is_dir() == (what == "archive-folder")]
        return case.folder / source if what == "archive" else chosen[recipe["which"] % len(chosen)]
    return None


def run_streams(case: Case, recipe: Recipe) -> None:
    """Run a command whose output goes nowhere."""
    arguments, _, output = _prepare(case, recipe["command"])
    case.run(*arguments, outputs=_outputs(recipe["command"], output), streams=recipe["how"])


def run_places(case: Case, recipe: Recipe) -> None:
    """Put something else where a file is read or written."""
    arguments, source, output = _prepare(case, recipe["command"])
    where = recipe["where"]
    if where == "log":
        if recipe["command"] not in ("run", "simulate", "inspect", "tune", "reconstruction"):
            raise SkippedError("the command has no log")
        arguments, name = (*arguments, "--log-file", "run.log"), "run.log"
    elif where == "parent":
        if output is None:
            raise SkippedError("the command writes nothing")
        arguments, name = tuple(f"deep/{word}" if word == output else word for word in arguments), "deep"
    else:
        name = source if where == "input" else output
        if name is None:
            raise SkippedError("the command has no such file")
    byte_edits.edited(case.folder / name, [recipe["edit"]])
    # What a link to nothing leads to may be made: a folder above, a log, the output itself.
    above = ("deep", "not-there") if where in ("parent", "log", "output") else ("deep",)
    case.run(*arguments, outputs=(*_outputs(recipe["command"], output), *above))


def run_full_disk(case: Case, recipe: Recipe) -> None:
    """Run a command on a nearly full disk."""
    with _small_disk(case.folder / "disk") as disk:
        inside = Case(case.program, case.specimens, disk)
        arguments, _, output = _prepare(inside, recipe["command"])
        if output is None:
            raise SkippedError("the command writes nothing")
        room = max(_held(disk) + 1024 * recipe["kilobytes"], 64 * 1024)
        shrunk = subprocess.run(
            ["mount", "-o", f"remount,size={room}", str(disk.parent)], check=False, capture_output=True
        )
        if shrunk.returncode:
            raise SkippedError("the file system cannot be made that small")
        inside.run(*arguments, outputs=_outputs(recipe["command"], output))
        case.faults, case.transcript = inside.faults, inside.transcript


@contextmanager
def _small_disk(folder: Path) -> Iterator[Path]:
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(folder)], capture_output=True, check=False
    )
    if mounted.returncode:
        raise SkippedError(os.strerror(errno.EPERM))
    inside = folder / uuid.uuid4().hex[:8]
    inside.mkdir()
    try:
        yield inside
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def _held(folder: Path) -> int:
    """Bytes that a file system in memory uses for what is below a folder."""
    return sum(4096 + -(-path.lstat().st_size // 4096) * 4096 for path in folder.rglob("*") if not path.is_dir())


def run_words(case: Case, recipe: Recipe) -> None:
    """Run the very command line of a recipe, on inputs that it names."""
    for name, specimen in recipe["inputs"].items():
        case.copy(getattr(case.specimens, specimen)(), name)
    case.add_bystanders()
    _expect_status(case, recipe, case.run(*recipe["arguments"], outputs=tuple(recipe["outputs"])))


RUN: dict[str, Callable[[Case, Recipe], None]] = {
    "observation": run_observations, "seaexplorer": run_seaexplorer, "slocum": run_slocum,
    "slocum-netcdf": run_slocum_netcdf, "seaglider": run_seaglider, "og1": run_og1, "yaml": run_yaml,
    "command-line": run_command_line, "archive": run_archive, "permissions": run_permissions, "streams": run_streams,
    "places": run_places, "full-disk": run_full_disk, "words": run_words,
}  # fmt: skip
"""Functions that run a recipe, by its kind."""
