"""Random damage of an archive: bytes, whole files, JSON metadata, and foreign files."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

from benchmarks.fuzzing import byte_edits

Edit = list[Any]

CHUNK, METADATA, MARKER, ROOT, ANY = "chunk", "metadata", "marker", "root", "any"


def files_of(archive: Path, what: str) -> list[Path]:
    """Files of an archive of one sort, sorted."""
    files = sorted(path for path in archive.rglob("*") if path.is_file() or path.is_symlink())
    if what == ROOT:
        return [archive / "zarr.json"]
    if what == METADATA:
        return [path for path in files if path.name == "zarr.json"]
    if what == CHUNK:
        return [path for path in files if path.name.startswith("c.") or "c" in path.relative_to(archive).parts]
    if what == MARKER:
        return [path for path in files if "commit" in path.as_posix() or path.suffix == ".json"]
    return files


def damaged(archive: Path, edits: list[Edit]) -> list[str]:
    """Apply edits; gives the files that were damaged, relative to the archive."""
    names = []
    for what, which, name, *rest in edits:
        if what == "lock":
            lock = archive.with_name(archive.name + ".lock")
            if name in byte_edits.PLACES:
                lock.touch()
                byte_edits.edited(lock, [[name]])
            else:
                lock.write_bytes(bytes.fromhex(name))
            continue
        if what == "stray":
            (archive / str(which)).mkdir(parents=True, exist_ok=True)
            (archive / str(which) / name).write_bytes(b"stray")
            continue
        chosen = files_of(archive, what)
        if not chosen:
            continue
        path = chosen[which % len(chosen)]
        names.append(path.relative_to(archive).as_posix())
        if name == "json":
            _edit_json(path, *rest)
        elif name == "remove-folder":
            shutil.rmtree(path.parent)
        elif name == "copy-of":
            path.write_bytes(chosen[rest[0] % len(chosen)].read_bytes())
        else:
            byte_edits.edited(path, [[name, *rest]])
    return names


def _edit_json(path: Path, which: int, how: str, value: Any) -> None:
    """Set, drop or add one entry of a JSON file, wherever it is nested."""
    try:
        content = json.loads(path.read_bytes())
    except ValueError:
        return  # Another edit has made it something else.
    places = list(_places(content))
    holder, key = places[which % len(places)]
    if how == "drop":
        del holder[key]
    elif how == "add" and isinstance(holder, dict):
        holder["surprise"] = value
    else:
        holder[key] = value
    path.write_text(json.dumps(content), "utf-8")


def _places(content: Any) -> list[tuple[Any, Any]]:
    """Every holder and key, depth first."""
    found: list[tuple[Any, Any]] = []
    entries = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in entries:
        found.append((content, key))
        found.extend(_places(value))
    return found
