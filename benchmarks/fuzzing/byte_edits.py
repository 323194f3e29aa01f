"""Edits of any file: as bytes, as lines of text, or by replacing it in the file system."""

from __future__ import annotations

import gzip
import os
import shutil
import socket
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

Edit = list[Any]


def edited(path: Path, edits: list[Edit]) -> None:
    """Apply edits to a file in place, one after the other."""
    for name, *rest in edits:
        if name in PLACES:
            PLACES[name](path)
        elif path.is_file() and stat.S_ISREG(path.lstat().st_mode):
            content = path.read_bytes()
            changed = TEXT[name](content, *rest) if name in TEXT else BYTES[name](content, *rest)
            path.write_bytes(changed)


def _at(content: bytes, fraction: float) -> int:
    return min(int(fraction * len(content)), max(len(content) - 1, 0))


def flip(content: bytes, fraction: float, bit: int) -> bytes:
    """Flip one bit."""
    if not content:
        return content
    place = _at(content, fraction)
    return content[:place] + bytes([content[place] ^ (1 << bit % 8)]) + content[place + 1 :]


def overwrite(content: bytes, fraction: float, code: str) -> bytes:
    """Write other bytes over some."""
    place, new = _at(content, fraction), bytes.fromhex(code)
    return content[:place] + new + content[place + len(new) :]


def insert(content: bytes, fraction: float, code: str) -> bytes:
    """Insert bytes."""
    place = _at(content, fraction)
    return content[:place] + bytes.fromhex(code) + content[place:]


def truncate(content: bytes, fraction: float) -> bytes:
    """Cut the end off."""
    return content[: int(fraction * len(content))]


def compress(content: bytes) -> bytes:
    """Compress the file."""
    return gzip.compress(content, mtime=0)


def encode(content: bytes, name: str) -> bytes:
    """Write text in another encoding."""
    return content.decode("utf-8", "replace").encode(name, "replace")


def newline(content: bytes, code: str) -> bytes:
    """End lines in another way."""
    return content.replace(b"\n", bytes.fromhex(code))


BYTES: dict[str, Callable[..., bytes]] = {
    "flip": flip, "overwrite": overwrite, "insert": insert, "truncate": truncate, "gzip": compress, "encode": encode,
    "newline": newline, "empty": lambda _: b"", "swap-bytes": lambda content: content[::-1],
}  # fmt: skip
"""Edits of bytes by the name that recipes use."""


def _lines(content: bytes) -> list[str]:
    return content.decode("utf-8", "surrogateescape").split("\n")


def _joined(lines: list[str]) -> bytes:
    return "\n".join(lines).encode("utf-8", "surrogateescape")


def line_drop(content: bytes, fraction: float, count: int) -> bytes:
    """Leave lines out."""
    lines = _lines(content)
    place = int(fraction * len(lines))
    return _joined(lines[:place] + lines[place + count :])


def line_repeat(content: bytes, fraction: float, count: int) -> bytes:
    """Repeat a line."""
    lines = _lines(content)
    place = min(int(fraction * len(lines)), len(lines) - 1)
    return _joined(lines[:place] + [lines[place]] * count + lines[place:])


def line_swap(content: bytes, first: float, second: float) -> bytes:
    """Exchange two lines."""
    lines = _lines(content)
    a, b = (min(int(fraction * len(lines)), len(lines) - 1) for fraction in (first, second))
    lines[a], lines[b] = lines[b], lines[a]
    return _joined(lines)


def line_add(content: bytes, fraction: float, text: str) -> bytes:
    """Insert a line."""
    lines = _lines(content)
    place = int(fraction * len(lines))
    return _joined([*lines[:place], text, *lines[place:]])


def field(content: bytes, row: float, column: int, text: str) -> bytes:
    """Replace one field of a table whose fields end with semicolons."""
    lines = _lines(content)
    place = min(int(row * len(lines)), len(lines) - 1)
    lines[place] = _field_replaced(lines[place], column, text)
    return _joined(lines)


def column(content: bytes, number: int, text: str) -> bytes:
    """Replace one column of a table in all rows but the head."""
    head, *rows = _lines(content)
    return _joined([head, *(_field_replaced(row, number, text) if row else row for row in rows)])


def heading(content: bytes, number: int, text: str) -> bytes:
    """Rename a column of a table."""
    head, *rows = _lines(content)
    return _joined([_field_replaced(head, number, text), *rows])


def replace(content: bytes, old: str, new: str, count: int = -1) -> bytes:
    """Replace a text."""
    return _joined(_lines(content)).replace(old.encode(), new.encode("utf-8", "surrogatepass"), count)


def _field_replaced(line: str, number: int, text: str) -> str:
    fields = line.split(";")
    fields[number % len(fields)] = text
    return ";".join(fields)


TEXT: dict[str, Callable[..., bytes]] = {
    "line-drop": line_drop, "line-repeat": line_repeat, "line-swap": line_swap, "line-add": line_add, "field": field,
    "column": column, "heading": heading, "replace": replace,
}  # fmt: skip
"""Edits of text by the name that recipes use."""


def _cleared(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _folder(path: Path) -> None:
    _cleared(path)
    path.mkdir()


def _fifo(path: Path) -> None:
    _cleared(path)
    os.mkfifo(path)


def _dangling(path: Path) -> None:
    _cleared(path)
    path.symlink_to(path.with_name("not-there"))


def _loop(path: Path) -> None:
    _cleared(path)
    path.symlink_to(path.name)


def _socket(path: Path) -> None:
    _cleared(path)
    # An address holds 108 bytes: it is given relative to its folder.
    before = Path.cwd()
    os.chdir(path.parent)
    try:
        with socket.socket(socket.AF_UNIX) as made:
            made.bind(path.name)
    finally:
        os.chdir(before)


def _device(path: Path) -> None:
    _cleared(path)
    path.symlink_to("/dev/null")


PLACES: dict[str, Callable[[Path], None]] = {
    "gone": _cleared, "folder": _folder, "fifo": _fifo, "dangling": _dangling, "loop": _loop, "socket": _socket,
    "device": _device, "unreadable": lambda path: path.chmod(0),
}  # fmt: skip
"""Things other than a file that may lie where one is expected, by the name that recipes use."""
