"""YAML files of one kind that a user names or gives the path of: those shipped with the package, and the user's own."""

import difflib
from collections.abc import Iterable
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
        What messages call it, such as ``platform``.
    package, folder : str
        The package that holds those shipped, and their folder in it.
    example : str
        Where a user sees how such a file is written; the end of a message.
    """

    kind: str
    package: str
    folder: str
    example: str

    def names(self) -> list[str]:
        """Names of the files that come with the package, sorted."""
        entries = (entry.name for entry in (resources.files(self.package) / self.folder).iterdir())
        return sorted(name.removesuffix(_YAML) for name in entries if name.endswith(_YAML))

    def text(self, name_or_path: str | Path) -> tuple[str, str]:
        """Name for messages, and the text, of a shipped file (these win over a file of the same name) or of a path.

        Raises
        ------
        InputError
            No such file, no regular one, too large, or not text.
        """
        name, shipped = str(name_or_path), self.names()
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
        """Name for messages, and the file's keys and values.

        Raises
        ------
        InputError
            No such file, not YAML, a key twice, or no keys and values.
        """
        label, text = self.text(name_or_path)
        content = parse_yaml(text, label)
        if not isinstance(content, dict):
            raise InputError(f"{label}: not a {self.kind} file; it must hold `key: value` lines, {self.example}")
        return label, content


def nearest(word: str, known: Iterable[str]) -> str:
    """Suggestion to append to a message, empty where nothing is close."""
    by_lower = {name.lower(): name for name in known}
    matches = difflib.get_close_matches(word.lower(), by_lower, n=1)
    return f", did you mean '{by_lower[matches[0]]}'?" if matches else ""
