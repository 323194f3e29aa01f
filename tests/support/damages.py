"""Damages of an archive, one after the other, as disks, copying and users cause them in a Zarr store."""

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

Damage = Callable[[Path], None]

WRONG = (None, True, -1, 1e308, "x" * 300, [], ["a"], {}, {"a": 1}, "\x1b[2J[red]")
"""Values that an attribute should not have."""


def damages(archive: Path) -> Iterator[tuple[str, Damage]]:
    """Yield every damage of an archive by a name; each takes the copy to damage."""
    for metadata in sorted(archive.rglob("zarr.json")):
        name = metadata.relative_to(archive)
        for how, content in _CONTENTS.items():
            yield f"{name} {how}", _rewriting(name, content)
        yield f"{name} missing", _removing(name)
        yield f"{name} a folder", _making_folder(name)
        yield f"{name} a dangling link", _dangling(name)
        for key in json.loads(metadata.read_text("utf-8")):
            yield f"{name} without {key}", _editing(name, _without(key))
    for group in sorted(path for path in archive.iterdir() if path.is_dir()):
        yield f"{group.name} missing", _removing(Path(group.name))
        yield f"{group.name} a file", _making_file(Path(group.name))
    for key in json.loads((archive / "zarr.json").read_text("utf-8"))["attributes"]:
        yield f"root attribute {key} missing", _editing(Path("zarr.json"), _without_attribute(key))
        for value in WRONG:
            yield (
                f"root attribute {key} = {str(value)[:20]!r}",
                _editing(Path("zarr.json"), _with_attribute(key, value)),
            )
    for metadata in sorted(archive.rglob("zarr.json")):
        name = metadata.relative_to(archive)
        if json.loads(metadata.read_text("utf-8"))["node_type"] == "array":
            for key, value in _ARRAYS:
                yield f"{name} {key} = {str(value)[:20]}", _editing(name, _with(key, value))
            chunks = sorted(path for path in metadata.parent.rglob("*") if path.is_file() and path.name != "zarr.json")
            for chunk in chunks[:1]:
                for how, content in _CONTENTS.items():
                    yield f"{chunk.relative_to(archive)} {how}", _rewriting(chunk.relative_to(archive), content)
                yield f"{chunk.relative_to(archive)} a folder", _making_folder(chunk.relative_to(archive))


_CONTENTS: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda _: b"",
    "truncated": lambda content: content[: len(content) // 2],
    "rubbish": lambda _: bytes(range(256)) * 4,
    "a number": lambda _: b"17",
    "nested": lambda _: b"[" * 5000,
    "longer": lambda content: content + b"\0\0",
}

_ARRAYS = (
    ("data_type", "float16"), ("data_type", "string"), ("data_type", 5), ("shape", [1]), ("shape", []), ("shape", "x"),
    ("shape", [10**12, 10**12]), ("dimension_names", ["a", "b"]), ("dimension_names", None), ("attributes", []),
    ("attributes", {"units": 5}), ("attributes", {"units": "days since 1970-01-01"}), ("codecs", []),
    ("codecs", [{"name": "none"}]), ("fill_value", "x"), ("node_type", "group"), ("zarr_format", 2),
)  # fmt: skip


def _rewriting(name: Path, change: Callable[[bytes], bytes]) -> Damage:
    return lambda archive: _put(archive / name, change((archive / name).read_bytes()))


def _put(path: Path, content: bytes) -> None:
    """Replace a file, which may be a link to a file of an intact archive."""
    path.unlink()
    path.write_bytes(content)


def _removing(name: Path) -> Damage:
    return lambda archive: shutil.rmtree(archive / name) if (archive / name).is_dir() else (archive / name).unlink()


def _making_folder(name: Path) -> Damage:
    def make(archive: Path) -> None:
        (archive / name).unlink()
        (archive / name).mkdir()

    return make


def _making_file(name: Path) -> Damage:
    def make(archive: Path) -> None:
        shutil.rmtree(archive / name)
        (archive / name).write_bytes(b"x")

    return make


def _dangling(name: Path) -> Damage:
    def make(archive: Path) -> None:
        (archive / name).unlink()
        (archive / name).symlink_to("nowhere")

    return make


def _editing(name: Path, edit: Callable[[dict[str, Any]], None]) -> Damage:
    def make(archive: Path) -> None:
        content = json.loads((archive / name).read_text("utf-8"))
        edit(content)
        _put(archive / name, json.dumps(content).encode())

    return make


def _without(key: str) -> Callable[[dict[str, Any]], None]:
    return lambda content: content.pop(key) and None


def _with(key: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda content: content.update({key: value})


def _without_attribute(key: str) -> Callable[[dict[str, Any]], None]:
    return lambda content: content["attributes"].pop(key) and None


def _with_attribute(key: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda content: content["attributes"].update({key: value})
