"""Pins: digests of all output of the program, to test a change of its structure.

Usage: ``python -m benchmarks.pins take PINS.json [--tree TREE] [--data FOLDER] [--only NAME ...]`` runs the commands of
TREE (default: this one) on a synthetic mission and on real ones, and writes a digest of every variable and attribute of
what they leave; ``python -m benchmarks.pins hold PINS.json [...]`` does the same and names what differs, with exit
status 1 where something does. Real missions are left out where DATA_FOLDER lacks them.

Digests go with the machine: other vector registers round otherwise. Take and hold on the same one.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr

REPOSITORY = Path(__file__).resolve().parents[1]

Pins = dict[str, str]
"""Digest by name: ``MISSION/FILE/GROUP/VARIABLE``, and ``...@ATTRIBUTE`` of an attribute."""

PASSING = {
    "run_seconds", "marker", "manifest", "observations", "observations_digest", "history", "date_created",
    "date_modified", "software_version", "source", "platform_digest", "digests", "seconds", "id", "uuid",
}  # fmt: skip
"""Variables, attributes and columns that depend on the time, place or version of a run."""

_DURATION = re.compile(r".*_seconds(/c\.0)?|time a (window|dive)(, filter)?")
"""Names of variables and columns with run times."""


@dataclass(frozen=True)
class Mission:
    """A mission and the commands that are run on it, in an empty folder.

    Attributes
    ----------
    name : str
    source : str
        Folder of the data that it needs, empty for a synthetic one.
    commands : tuple of str
        Arguments of ``gliderhpc``; ``{source}`` is that folder.
    """

    name: str
    source: str
    commands: tuple[str, ...]


_EXPORTS = ("export og1 a.zarr og1.nc", "export currents a.zarr currents.nc")

MISSIONS = (
    Mission("twin", "", (
        "simulate-mission m.nc --platform petrel-l --scenario demo --profiles 4 --seed 2 --workers 0",
        "run-mission m.nc --platform petrel-l --store a.zarr --workers 0",
        "run-mission m.nc --platform petrel-l --store paper.zarr --profiles 1 --set preset=paper --workers 0",
        "run-mission m.nc --platform petrel-l --store scipy.zarr --profiles 1 --engine scipy --workers 0",
        "validate m.nc --platform petrel-l --store a.zarr --workers 0 --out validation",
        "analyze a.zarr all --quick --workers 0 --out studies",
        "analyze a.zarr reconstruction --observations m.nc --truth m.truth.nc --workers 0 --out with-truth",
        "inspect m.nc --platform petrel-l",
        "calibrate m.nc --platform petrel-l --profiles 1:3 --hold-out 4 --out fitted.yaml",
        "tune m.nc --platform petrel-l --profiles 1 --out tuned.yaml",
        *_EXPORTS,
    )),
    Mission("seaexplorer", "seaexplorer-sea035-M012", (
        "import seaexplorer {source} m.nc",
        "run-mission m.nc --platform seaexplorer --store a.zarr --profiles 43:44 --workers 0",
        "validate m.nc --platform seaexplorer --store a.zarr --workers 0 --out validation",
        "analyze a.zarr all --workers 0 --out studies",
        *_EXPORTS,
    )),
    Mission("seaglider", "seaglider-sg249-nanoos-2024", (
        "import seaglider {source}/*.nc m.nc",
        "run-mission m.nc --platform seaglider --store a.zarr --workers 0",
        "analyze a.zarr all --workers 0 --out studies",
        *_EXPORTS,
    )),
    Mission("og1", "seaglider-sg033-og1-2010", ("import og1 {source}/*.nc m.nc",)),
    Mission("slocum", "slocum-modena-2015-days17-29", (
        "run-mission {source}/modena.nc --platform slocum --store a.zarr --profiles 17:18 --workers 0",
        "analyze a.zarr all --quick --workers 0 --out studies",
        *_EXPORTS,
    )),
    Mission("experiments", "", tuple(
        f"twin {name} --quick --seeds {seeds} --platform petrel-l --workers 0 --out {name}"
        for name, seeds in (("currents", 12), ("estimators", 2), ("recoverability", 3), ("sensitivity", 2), ("windows", 2))
    )),
)  # fmt: skip


def take(tree: Path, data: Path, only: list[str]) -> Pins:
    """Run the commands of a tree and digest what they leave."""
    pins: Pins = {}
    for mission in MISSIONS:
        source = data / mission.source
        if (only and mission.name not in only) or (mission.source and not source.is_dir()):
            print(f"{mission.name}: left out", file=sys.stderr)
            continue
        with tempfile.TemporaryDirectory() as folder:
            for command in mission.commands:
                pins |= {f"{mission.name}/{command}": _run(tree, Path(folder), command, source)}
            pins |= {f"{mission.name}/{name}": digest for name, digest in _digests(Path(folder))}
    return pins


def _run(tree: Path, folder: Path, command: str, source: Path) -> str:
    """Run a command; its exit status is pinned too."""
    arguments = [word for text in command.split() for word in _expanded(text.format(source=source))]
    environment = {**os.environ, "PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "gliderhpc", *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    print(f"{done.returncode}  {command}", file=sys.stderr, flush=True)
    if done.returncode == 2:
        raise SystemExit(f"gliderhpc {command}: {done.stderr.strip()}")
    return str(done.returncode)


def _expanded(word: str) -> list[str]:
    path = Path(word)
    return [str(one) for one in sorted(path.parent.glob(path.name))] if "*" in word else [word]


def _digests(folder: Path) -> Iterator[tuple[str, str]]:
    """Digest everything below a folder that is no picture: archives and netCDF by variable, tables by column."""
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if any(part.endswith(".zarr") for part in path.relative_to(folder).parent.parts):
            continue
        if path.suffix == ".zarr":
            yield from _of_archive(name, path)
        elif path.suffix == ".nc":
            yield from _of_netcdf(name, path)
        elif path.suffix == ".json":
            yield from _of_json(name, json.loads(path.read_text("utf-8")))
        elif path.suffix == ".csv":
            yield from _of_table(name, path)
        elif path.suffix == ".yaml":
            yield name, _digest(path.read_bytes())


def _is_passing(name: str) -> bool:
    return name in PASSING or bool(_DURATION.fullmatch(name))


def _of_table(name: str, path: Path) -> Iterator[tuple[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for column in rows[0] if rows else ():
        if not _is_passing(column):
            yield f"{name}.{column}", _digest("\n".join(row[column] for row in rows).encode())


def _of_archive(name: str, path: Path) -> Iterator[tuple[str, str]]:
    root = zarr.open_group(path, mode="r", use_consolidated=False)
    yield from _of_json(f"{name}/@", dict(root.attrs))
    for label, member in sorted(root.members(max_depth=None)):
        yield from _of_json(f"{name}/{label}@", dict(member.attrs))
        if isinstance(member, zarr.Array) and not _is_passing(label.rpartition("/")[2]):
            yield f"{name}/{label}", _of_values(np.asarray(member[...]))


def _of_netcdf(name: str, path: Path) -> Iterator[tuple[str, str]]:
    with xr.open_dataset(path, decode_cf=False) as dataset:
        yield from _of_json(f"{name}/@", dict(dataset.attrs))
        for label, variable in sorted(dataset.variables.items(), key=lambda item: str(item[0])):
            yield from _of_json(f"{name}/{label}@", dict(variable.attrs))
            if not _is_passing(str(label)):
                yield f"{name}/{label}", _of_values(np.asarray(variable.values))


def _of_json(name: str, content: Any) -> Iterator[tuple[str, str]]:
    """Digest JSON by its leaves, so that what differs has a name."""
    if isinstance(content, Mapping):
        for key, value in content.items():
            if not _is_passing(key):
                yield from _of_json(f"{name}.{key}", value)
    elif isinstance(content, list) and content and all(isinstance(one, Mapping) for one in content):
        yield from _of_json(name, {str(one.get("quantity", place)): one for place, one in enumerate(content)})
    else:
        yield name, _digest(json.dumps(content, default=repr, sort_keys=True).encode())


def _of_values(values: np.ndarray) -> str:
    text = values.dtype.kind in "TOUS"
    content = json.dumps(values.tolist(), default=str).encode() if text else np.ascontiguousarray(values).tobytes()
    return _digest(f"{values.shape} {'text' if text else values.dtype} ".encode() + content)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


def differences(before: Pins, after: Pins) -> list[str]:
    """Name what differs, a line a pin."""
    lines = [f"gone: {name}" for name in sorted(before.keys() - after.keys())]
    lines += [f"new: {name}" for name in sorted(after.keys() - before.keys())]
    return lines + [f"differs: {name}" for name in sorted(before.keys() & after.keys()) if before[name] != after[name]]


def main() -> None:
    """Take pins, or compare a tree with them."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pins", description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("take", "hold"))
    parser.add_argument("pins", type=Path)
    parser.add_argument("--tree", type=Path, default=REPOSITORY)
    parser.add_argument("--data", type=Path, default=REPOSITORY.parent / "shared" / "data")
    parser.add_argument("--only", nargs="*", default=[], choices=[mission.name for mission in MISSIONS])
    chosen = parser.parse_args()
    found = take(chosen.tree.resolve(), chosen.data, chosen.only)
    if chosen.what == "take":
        chosen.pins.write_text(json.dumps(found, indent=1, sort_keys=True) + "\n", "utf-8")
        print(f"{len(found)} pins")
        return
    before = json.loads(chosen.pins.read_text("utf-8"))
    if chosen.only:
        before = {name: digest for name, digest in before.items() if name.split("/")[0] in chosen.only}
    lines = differences(before, found)
    print(*lines, f"{len(found)} pins, {len(lines)} differ", sep="\n")
    sys.exit(1 if lines else 0)


if __name__ == "__main__":
    main()
