"""Invariants for any input: permitted exit statuses, permitted changes, and impossible values."""

from __future__ import annotations

import hashlib
import re
import stat
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from benchmarks.fuzzing.program import Ended

CLASSES = ("tracebacks", "hangs", "memory", "status", "changed", "wrong", "lost")
STATUSES = (0, 1, 2, 130, 141)
MAX_CURRENT = 5.0
"""Speed of a current (m/s) that no ocean has."""

IMPORTED = ("depth", "pitch", "heading", "battery_position", "ballast_volume")
"""Variables without which no record can be inverted."""

_MEMORY = re.compile(r"MemoryError|Unable to allocate|Cannot allocate memory|std::bad_alloc")
_FRAME = re.compile(r'File ".*?/(gliderhpc/[^"]+)", line (\d+), in (\S+)')
_NOISE = re.compile(
    r"Exception ignored|Fatal Python error|Segmentation fault|^Traceback|Traceback \(most", re.MULTILINE
)

Snapshot = dict[str, tuple[int, str]]


@dataclass(frozen=True)
class Fault:
    """One broken invariant: its class, and a line that is alike for the same cause."""

    name: str
    detail: str


def snapshot(folder: Path) -> Snapshot:
    """Kind and digest of everything below a folder."""
    found = {}
    for path in sorted(folder.rglob("*")):
        mode = path.lstat().st_mode
        text = ""
        if stat.S_ISLNK(mode):
            text = str(path.readlink())
        elif stat.S_ISREG(mode):
            text = hashlib.blake2b(path.read_bytes(), digest_size=12).hexdigest()
        found[path.relative_to(folder).as_posix()] = (stat.S_IFMT(mode), text)
    return found


def changes(before: Snapshot, after: Snapshot, outputs: Iterable[str], status: int) -> list[Fault]:
    """Changes that are not allowed: of anything but the outputs, and with status 2 any change."""
    named = tuple(outputs)
    faults = []
    for name in sorted(before.keys() | after.keys()):
        if before.get(name) == after.get(name) or (stat.S_ISDIR(after.get(name, (0, ""))[0]) and name in before):
            continue
        allowed = any(name == out or name.startswith(f"{out}/") for out in named)
        if not allowed and name not in after:
            faults.append(Fault("lost", f"{_top(name)} is gone, or part of it"))
        elif not allowed or status == 2:
            what = "changed" if name in before else "left behind"
            refused = " by a refused command" if status == 2 else ""
            faults.append(Fault("changed", f"{_top(name)} {what}{refused}"))
    return sorted(set(faults), key=lambda fault: fault.detail)


def _plain(name: str) -> str:
    return re.sub(r"\d+", "N", name)


def _top(name: str) -> str:
    """Name the file, of what lies in a folder the folder alone."""
    return _plain(name.split("/")[0])


def ended_well(ended: Ended, memory: int) -> list[Fault]:
    """Faults that the end of a call alone shows."""
    faults = []
    where = traced(ended.text)
    if ended.hung:
        faults.append(Fault("hangs", f"not ended, last line: {_last_line(ended.text)}"))
    elif _MEMORY.search(ended.text) or ended.peak > memory:
        faults.append(Fault("memory", where or _last_line(ended.text)))
    elif where is not None:
        faults.append(Fault("tracebacks", where))
    elif ended.status not in STATUSES and not (ended.killed and ended.status < 0):
        faults.append(Fault("status", f"status {ended.status}: {_last_line(ended.text)}"))
    return faults


def traced(text: str) -> str | None:
    """Error and last own frame of the traceback in an output, None without one."""
    if not _NOISE.search(text):
        return None
    frames = _FRAME.findall(text)
    errors = re.findall(r"^(\w[\w.]*(?:Error|Exception|Interrupt|Warning|Exit)\b.*)$", text, re.MULTILINE)
    error = re.sub(r"0x[0-9a-f]+|\d+|'[^']*'|\"[^\"]*\"", "N", errors[-1])[:90] if errors else _last_line(text)
    return f"{error} in {frames[-1][0]}:{frames[-1][2]}" if frames else error


def _last_line(text: str) -> str:
    lines = [line for line in text.splitlines() if line.strip()]
    return re.sub(r"\d+", "N", lines[-1])[:120] if lines else "no output"


def archive_nonsense(store: Path, output: str, lied: bool) -> list[Fault]:
    """Results in an archive that nobody may believe: an impossible current, errors that are no numbers, no message.

    `lied` says that the records were falsified in a way that must not pass without a message.
    """
    if not (store / "zarr.json").is_file():
        return []
    table = xr.open_zarr(store, consolidated=False).load()
    faults = []
    done = np.array([str(status) == "done" for status in table["status"].values])
    messages = np.array([str(message) for message in table["message"].values])
    for suffix in ("", "_smoothed"):
        names = [f"dac_{way}{suffix}" for way in ("north", "east")]
        if not all(name in table and f"{name}_std" in table for name in names):
            continue
        current = np.hypot(*(table[name].values for name in names))
        error = np.sum([table[f"{name}_std"].values for name in names], axis=0)
        if np.any(done & (current > MAX_CURRENT)):
            faults.append(Fault("wrong", f"done with an impossible current{suffix}"))
        if np.any(done & np.isfinite(current) & ~(error > 0.0)):
            faults.append(Fault("wrong", f"done, the current{suffix} has no error"))
        if not suffix and np.any(done & ~np.isfinite(current) & (messages == "")):
            faults.append(Fault("wrong", "done without current and without message"))
    if lied and done.all() and not any(messages) and "warning" not in output.lower():
        faults.append(Fault("wrong", "falsified records inverted without a word"))
    return faults


def observation_nonsense(path: Path, output: str) -> list[Fault]:
    """An observation file that an import wrote and that cannot be believed, unless its output names the variable."""
    if not path.is_file():
        return []
    with xr.open_dataset(path) as opened:
        data = opened.load()
    faults = []
    time = data["time"].values
    if time.size and (np.isnat(time).any() or (np.diff(time) <= np.timedelta64(0, "ns")).any()):
        faults.append(Fault("wrong", "imported times do not increase"))
    if time.size and (time.min() < np.datetime64("1980-01-01") or time.max() > np.datetime64("2100-01-01")):
        faults.append(Fault("wrong", "imported times of no glider"))
    for name, variable in data.data_vars.items():
        if variable.dtype.kind == "f" and np.isinf(variable.values).any():
            faults.append(Fault("wrong", f"imported {name} is infinite"))
    # A file of surface records alone is reported to hold no profile.
    unnamed = [name for name in IMPORTED if data[name].size and name not in output and "no profile" not in output]
    empty = [name for name in unnamed if not np.isfinite(data[name].values).any()]
    return [*faults, *(Fault("wrong", f"imported {name} holds no number") for name in empty)]


def same_netcdf(first: Path, second: Path) -> bool:
    """Return whether two netCDF files hold the same variables and values."""
    with xr.open_dataset(first, decode_times=False) as one, xr.open_dataset(second, decode_times=False) as other:
        return bool(one.equals(other))
