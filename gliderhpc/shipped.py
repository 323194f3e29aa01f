"""YAML files of one kind, given by name or path: those shipped with the package, and the user's own."""

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from gliderhpc.errors import InputError
from gliderhpc.yaml_text import parse_yaml, read_yaml_text

_YAML = ".yaml"


@dataclass(frozen=True)
class ShippedFiles:
    """One kind of file.

    Attributes
    ----------
    kind : str
        Kind of file in messages, such as ``platform``.
    package, folder : str
        Package with the shipped files, and their folder in it.
    example : str
        Reference to an example; the end of a message.
    """

    kind: str
    package: str
    folder: str
    example: str

    def names(self) -> list[str]:
        """Return the names of the shipped files, sorted."""
        entries = (entry.name for entry in (resources.files(self.package) / self.folder).iterdir())
        return sorted(name.removesuffix(_YAML) for name in entries if name.endswith(_YAML))

    def text(self, name_or_path: str | Path) -> tuple[str, str]:
        """Return the name for messages and the text of a shipped file, which takes precedence, or of a path.

        Raises
        ------
        InputError
            The file does not exist, is not a regular file, is too large, or is not text; or a name or path is expected
            and another object is given.
        """
        if not isinstance(name_or_path, str | Path):
            raise InputError(f"{self.kind}: give a name or a path, not a {type(name_or_path).__name__}")
        name, shipped = str(name_or_path), self.names()
        if not name:
            raise InputError(
                f"{self.kind}: the name is empty; give one of {', '.join(shipped)}, or the path of a YAML file"
            )
        if name in shipped:
            file = f"{name}{_YAML}"
            return file, (resources.files(self.package) / self.folder / file).read_text("utf-8")
        path = Path(name_or_path)
        if not path.exists() and path.name == name and path.suffix not in {_YAML, ".yml"}:
            raise InputError(
                f"unknown {self.kind} '{name}'{nearest(name, shipped)}; shipped are {', '.join(shipped)}, "
                "or give the path of a YAML file"
            )
        return str(path), read_yaml_text(path, self.kind)

    def content(self, name_or_path: str | Path) -> tuple[str, dict[str, Any]]:
        """Return the name for messages, and the file's keys and values.

        Raises
        ------
        InputError
            The file does not exist, is not YAML, repeats a key, or contains no keys and values.
        """
        label, text = self.text(name_or_path)
        content = parse_yaml(text, label)
        if not isinstance(content, dict):
            raise InputError(f"{label}: not a {self.kind} file; it must hold `key: value` lines, {self.example}")
        return label, content


def nearest(word: str, known: Iterable[str]) -> str:
    """Return a suggestion to append to a message, empty if no known word is similar."""
    similar = most_similar(word, known)
    return f", did you mean '{similar}'?" if similar is not None else ""


def describe_unknown_key(key: str, known: Sequence[str]) -> str:
    """Describe a key that its section of a file does not have, with the section's keys and the most similar one."""
    return f"unknown key '{key}'{nearest(key.rpartition('.')[2], known)}; keys are {', '.join(known)}"


def most_similar(word: str, known: Iterable[str]) -> str | None:
    """Return the known word that is most similar to a word; None if there is none."""
    by_lower = {name.lower(): name for name in known}
    matches = difflib.get_close_matches(word.lower(), by_lower, n=1)
    return by_lower[matches[0]] if matches else None
