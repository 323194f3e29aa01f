"""Operator's description of a deployment, from a YAML file: people, institutions, identifiers.

The file of pyglider (``deployment.yml``) can be used unchanged: its section ``metadata`` is read.
"""

import datetime
from collections.abc import Mapping
from pathlib import Path

from gliderhpc.errors import InputError
from gliderhpc.yaml_text import parse_yaml, read_yaml_text, shown

SECTION = "metadata"
"""Section of pyglider's files that contains the global attributes."""


def read_deployment(path: str | Path) -> dict[str, str]:
    """Read the global attributes of a deployment.

    Parameters
    ----------
    path : str or Path
        YAML file with entries ``name: text``, at the top level or in the section ``metadata``.

    Returns
    -------
    dict of str to str
        Texts by name of the attribute; lists are joined by commas, and names without a value are omitted.

    Raises
    ------
    InputError
        There is no such file, it is not YAML, a name is not valid for an attribute, or a value has an unsuitable type.
    """
    content = parse_yaml(read_yaml_text(Path(path), "deployment"), str(path))
    if isinstance(content, Mapping) and SECTION in content:
        content = content[SECTION]
    if not isinstance(content, Mapping):
        raise InputError(f"{path}: contains no attributes; write one per line, for example contributor_name: A. Name")
    texts = {_name(name, path): _text(name, value, path) for name, value in content.items() if value is not None}
    return {name: text for name, text in texts.items() if text}


def _name(name: object, path: str | Path) -> str:
    if not isinstance(name, str) or not name.isidentifier():
        raise InputError(f"{path}: {shown(name)} is not a valid attribute name; use letters, digits and underscores")
    return name


def _text(name: object, value: object, path: str | Path) -> str:
    if isinstance(value, list):
        return ", ".join(_text(name, part, path) for part in value)
    if not isinstance(value, str | int | float | datetime.date):
        raise InputError(f"{path}: {name} is not text but {shown(value)}; write its parts as separate attributes")
    return str(value).strip()
