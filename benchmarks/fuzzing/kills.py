"""Long commands killed at random moments: earlier results remain, and the documented remedy gives equal values."""

from __future__ import annotations

import re
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from benchmarks.fuzzing import verdicts
from benchmarks.fuzzing.kinds import Case
from benchmarks.fuzzing.program import Call, Program
from benchmarks.fuzzing.specimens import HULL, SCENARIO, Specimens, run_mission
from benchmarks.fuzzing.verdicts import Fault
from gliderhpc.store_schema.schema import STUDIES

Recipe = dict[str, Any]
Arguments = tuple[object, ...]

STUDY = ("--workers", 0, "--out", "study")
COMMANDS: dict[str, tuple[Arguments, Arguments, tuple[str, ...]]] = {
    "create": (run_mission("in.nc", "mission.zarr"), run_mission("in.nc", "mission.zarr", "--resume"), ("mission.zarr",)),
    "overwrite": (
        run_mission("in.nc", "mission.zarr", "--overwrite"), run_mission("in.nc", "mission.zarr", "--resume"),
        ("mission.zarr",),
    ),
    "append": (
        run_mission("in.nc", "mission.zarr", "--append"), run_mission("in.nc", "mission.zarr", "--append"),
        ("mission.zarr",),
    ),
    "resume": (
        run_mission("in.nc", "mission.zarr", "--resume"), run_mission("in.nc", "mission.zarr", "--resume"),
        ("mission.zarr",),
    ),
    "workers": (
        ("run-mission", "in.nc", "--platform", HULL, "--store", "mission.zarr", "--workers", 1),
        run_mission("in.nc", "mission.zarr", "--resume"), ("mission.zarr",),
    ),
    "analyze": (
        ("analyze", "mission.zarr", "reconstruction", *STUDY), ("analyze", "mission.zarr", "reconstruction", *STUDY),
        ("mission.zarr", "study"),
    ),
    "report": (("report", "mission.zarr", "--out", "page"), ("report", "mission.zarr", "--out", "page"), ("page",)),
    "validate": (
        ("validate", "in.nc", "--platform", HULL, "--store", "mission.zarr", *STUDY),
        ("validate", "in.nc", "--platform", HULL, "--store", "mission.zarr", *STUDY), ("mission.zarr", "study"),
    ),
    "export": (
        ("export", "og1", "mission.zarr", "out.nc", "--overwrite"),
        ("export", "og1", "mission.zarr", "out.nc", "--overwrite"), ("out.nc",),
    ),
    "calibrate": (
        ("calibrate", "in.nc", "--platform", HULL, "--out", "out.yaml", "--overwrite"),
        ("calibrate", "in.nc", "--platform", HULL, "--out", "out.yaml", "--overwrite"), ("out.yaml",),
    ),
    "tune": (
        ("tune", "in.nc", "--platform", HULL, "--set", "tuning.longest=30", "--out", "out.yaml", "--overwrite"),
        ("tune", "in.nc", "--platform", HULL, "--set", "tuning.longest=30", "--out", "out.yaml", "--overwrite"),
        ("out.yaml",),
    ),
    "import": (("import", "seaglider", "in", "out.nc"), ("import", "seaglider", "in", "out.nc"), ("out.nc",)),
    "simulate": (
        ("simulate-mission", "out.nc", "--platform", HULL, "--scenario", "in.yaml", "--workers", 0),
        ("simulate-mission", "out.nc", "--platform", HULL, "--scenario", "in.yaml", "--workers", 0),
        ("out.nc", "out.truth.nc"),
    ),
}  # fmt: skip
"""Commands that are killed, their remedies, and the files that both may write."""

SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
KILLS = st.fixed_dictionaries(
    {
        "kind": st.just("kill"),
        "command": st.sampled_from(list(COMMANDS)),
        "fraction": st.floats(0.0, 1.05),
        "signal": st.sampled_from([int(number) for number in SIGNALS]),
        "again": st.booleans(),
    }
)
"""Recipes of kills: the moment is a fraction of the time that the command takes undisturbed."""


def drawn_kills(command: str, count: int, random: np.random.Generator) -> Iterator[Recipe]:
    """Draw kills of one command: moments spread evenly over its time, in random order, each within its own share."""
    for share in random.permutation(count):
        yield {
            "kind": "kill",
            "command": command,
            "fraction": float(1.05 * (share + random.random()) / count),
            "signal": int(random.choice(SIGNALS)),
            "again": bool(random.integers(2)),
        }


AWAKE = 0.5
"""Seconds in which a program that was started has begun to listen to signals."""

_STUDIES = {group.name for group in STUDIES}
LOCK = "mission.zarr.lock"
"""Files that a killed run leaves and the next takes over."""

RUNS = ("create", "overwrite", "append", "resume", "workers")
_SECONDS: dict[tuple[str, str], float] = {}


def kill_one(recipe: Recipe, program: Program, specimens: Specimens, folder: Path) -> Case:
    """Kill a command, look at what is left, mend it and compare."""
    command = recipe["command"]
    first, mending, outputs = COMMANDS[command]
    undisturbed = _undisturbed(command, program, specimens)
    folder.mkdir(parents=True)
    case = Case(program, specimens, folder)
    try:
        _lay_out(case, command)
        case.add_bystanders()
        for arguments in (first, mending) if recipe["again"] and command in RUNS else (first,):
            moment = recipe["fraction"] * _SECONDS[program.tree.as_posix(), command]
            ended = case.run(*arguments, outputs=(*outputs, LOCK, *_set_aside(case)), kill=(moment, recipe["signal"]))
            # Until the program listens, in the first moments, a signal ends it as any.
            if ended.killed and recipe["signal"] != signal.SIGKILL and ended.status not in (0, 130) and moment > AWAKE:
                case.faults.append(Fault("status", f"{command}: interrupted, status {ended.status}"))
        if command in RUNS:
            _look(case, command)
        ended = case.run(*_mending(case, command, mending), outputs=(*outputs, LOCK, *_set_aside(case)))
        if ended.status != 0:
            last = ended.text.splitlines()[-1:] or [""]
            case.faults.append(Fault("lost", f"{command}: the remedy ends with {ended.status}: {_short(last[0])}"))
        else:
            _compare(case, command, undisturbed)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    case.faults = list(dict.fromkeys(case.faults))
    return case


def _short(text: str) -> str:
    return "".join(character for character in text if not character.isdigit())[:110]


def _mending(case: Case, command: str, mending: Arguments) -> Arguments:
    """Remedy of the program's pages: `--resume`, or the first command where nothing was made."""
    if command in RUNS and not (case.folder / "mission.zarr").exists():
        return tuple(word for word in mending if word not in ("--resume", "--append"))
    if (command == "simulate" and (case.folder / "out.nc").exists()) or (
        command == "import" and (case.folder / "out.nc").exists()
    ):
        return (*mending, "--overwrite") if _knows_overwrite(case, mending) else mending
    return mending


def _knows_overwrite(case: Case, arguments: Arguments) -> bool:
    words = [str(word) for word in arguments[: 2 if arguments[0] == "import" else 1]]
    return "--overwrite" in case.program.run(Call((*words, "--help"), case.folder)).text


def _lay_out(case: Case, command: str) -> None:
    case.copy(case.specimens.observations(), "in.nc")
    if command in ("overwrite", "analyze", "validate", "report", "export", "resume"):
        store = case.copy(case.specimens.archive(), "mission.zarr")
        if command == "resume":
            # Those of studies are for `analyze` to make again.
            chunks = [path for path in store.rglob("c.*") if path.relative_to(store).parts[0] not in _STUDIES]
            for path in chunks[::3]:
                path.unlink()
    if command == "append":
        case.copy(case.specimens.short_archive(), "mission.zarr")
    if command == "import":
        case.copy(case.specimens.seaglider(), "in")
    (case.folder / "in.yaml").write_text(SCENARIO, "utf-8")


def _look(case: Case, command: str) -> None:
    """After a kill an archive is readable or refused, and what had been there is still there."""
    if (case.folder / "mission.zarr").exists():
        case.run("info", "mission.zarr")
        case.run("check", "mission.zarr", "--deep")
    if command == "overwrite" and not _has_done(case.folder):
        case.faults.append(Fault("lost", "overwrite: killed before the first commit, and the old archive is gone"))


def _has_done(folder: Path) -> bool:
    """Return whether any archive below a folder has a committed profile."""
    return any(
        any(path.rglob("commit*")) and any(path.rglob("c.*"))
        for path in folder.iterdir()
        if path.is_dir() and path.name.startswith(("mission", "."))
    )


def _undisturbed(command: str, program: Program, specimens: Specimens) -> Path:
    """Folder of what the command leaves when nobody disturbs it; made twice, for the time of the second."""
    folder = specimens.folder / f"undisturbed-{command}"
    key = program.tree.as_posix(), command
    if key not in _SECONDS:
        for _ in range(2):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            case = Case(program, specimens, folder)
            _lay_out(case, command)
            ended = program.run(Call(tuple(map(str, COMMANDS[command][0])), folder))
            if ended.status != 0:
                raise RuntimeError(f"{command}: {ended.text}")
        _SECONDS[key] = ended.seconds
    return folder


def _compare(case: Case, command: str, undisturbed: Path) -> None:
    """Hold what the remedy left against what is left without a disturbance."""
    if command in (*RUNS, "analyze", "validate"):
        for check in (
            ("check", "mission.zarr", "--deep"),
            ("compare", "mission.zarr", str(undisturbed / "mission.zarr")),
        ):
            ended = case.program.run(Call(check, case.folder))
            if ended.status != 0:
                case.transcript.append({"arguments": check, "status": ended.status, "text": ended.text[-2000:]})
                case.faults.append(Fault("wrong", f"{command}: after the remedy {check[0]} ends with {ended.status}"))
        strays = [path.name for path in (case.folder / "mission.zarr").rglob("*.partial")]
        if strays:
            case.faults.append(Fault("wrong", f"{command}: {_short(strays[0])} is left"))
    elif command in ("export", "import"):
        if not verdicts.same_netcdf(case.folder / "out.nc", undisturbed / "out.nc"):
            case.faults.append(Fault("wrong", f"{command}: other values after a kill"))
    elif command in ("calibrate", "tune", "simulate"):
        name = "out.nc" if command == "simulate" else "out.yaml"
        if (case.folder / name).read_bytes() != (undisturbed / name).read_bytes():
            case.faults.append(Fault("wrong", f"{command}: another file after a kill"))
    # Whoever is killed outright cannot tidy up, and nobody else may: the file could be that of a run at work.
    outright = any(ended["status"] == -signal.SIGKILL for ended in case.transcript)
    left = [path.name for path in case.folder.iterdir() if _is_left(path.name)]
    left = [name for name in left if not (outright and _UNFINISHED.fullmatch(name))]
    if left:
        case.faults.append(Fault("changed", f"{command}: {_short(left[0])} is left behind"))


_UNFINISHED = re.compile(r"\..*|mission\.zarr\.[0-9a-f]{16}\.(partial|old)")


def _set_aside(case: Case) -> list[str]:
    """Archives that a killed run has set aside, which the next puts back."""
    return [path.name for path in case.folder.iterdir() if _UNFINISHED.fullmatch(path.name)]


def _is_left(name: str) -> bool:
    """Return whether a file next to the outputs is a leftover of the program."""
    ours = {"in", "in.nc", "in.yaml", "mission.zarr", "out.nc", "out.truth.nc", "out.yaml", "study", "page"}
    return name not in ours and name not in ("mission.zarr.old", "mission.zarr.partial", "out.nc.partial", "out.old")
