"""Strict parsing of users' YAML and of ``KEY=VALUE``, and the base of the models that validate the values."""

import reprlib
import stat
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from gliderhpc.errors import InputError

MAX_FILE_BYTES = 262_144
"""Size of the largest file, a hundred times that of the longest platform file."""

MAX_DEPTH = 20
"""Deepest nesting of lists and sections; our own files have four levels."""

MAX_ALIASES = 10
"""Largest number of references to a value elsewhere in the file; many of them can expand to gigabytes."""

_MERGE = "tag:yaml.org,2002:merge"

_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 80
_SHORT.maxlist = _SHORT.maxtuple = _SHORT.maxdict = 12


def shown(value: object) -> str:
    """Format a value, shortened if it is too long for a line."""
    return _SHORT.repr(value)


class UserValues(BaseModel):
    """Frozen values of a user: no unknown names, and only finite numbers up to `max_number`.

    A boolean in place of a number is refused; pydantic would take it for 1 or 0.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    max_number: ClassVar[float]
    max_number_rule: ClassVar[str]
    """Largest magnitude of a number, and the rule about it for the message."""

    @model_validator(mode="before")
    @classmethod
    def _no_boolean_numbers(cls, values: Any) -> Any:
        for name, value in values.items() if isinstance(values, Mapping) else ():
            field = cls.model_fields.get(name)
            if isinstance(value, bool) and field is not None and "bool" not in str(field.annotation):
                raise ValueError(f"{name} is {str(value).lower()}, but must be a number or one of the words for it")
        return values

    @model_validator(mode="after")
    def _not_huge(self) -> Self:
        for name in type(self).model_fields:
            value = getattr(self, name)
            for number in value if isinstance(value, tuple) else (value,):
                if isinstance(number, int | float) and abs(number) > self.max_number:
                    raise ValueError(f"{name} is {shown(number)}, but {self.max_number_rule}")
        return self


def read_yaml_text(path: Path, kind: str) -> str:
    """Read a user's YAML file.

    Parameters
    ----------
    path : Path
        The file.
    kind : str
        Kind of file in messages, such as ``platform``.

    Raises
    ------
    InputError
        The file does not exist, is not a regular file, is too large, or is not text.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise InputError(f"{path}: cannot be read, it is not a regular file; give a YAML {kind} file")
        if status.st_size > MAX_FILE_BYTES:
            raise InputError(
                f"{path}: is {status.st_size / 1e6:.1f} MB large, too large for a {kind} file "
                f"(at most {MAX_FILE_BYTES / 1e6:.2f} MB)"
            )
        return path.read_text("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file, so not a {kind} file; give a YAML {kind} file") from None
    except OSError as error:
        raise InputError(f"{path}: this {kind} file cannot be read ({error.strerror or error})") from None


def parse_yaml(text: str, label: str) -> Any:
    """Parse a YAML text.

    Parameters
    ----------
    text : str
        The text.
    label : str
        Name of the text in messages.

    Raises
    ------
    InputError
        The text is not YAML, repeats a key, is nested too deeply, or has too many aliases; with the line.
    """
    try:
        return yaml.load(text, Loader=_StrictLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark is not None else ""
        problem = getattr(error, "problem", None) or "cannot parse it"
        if isinstance(error, _RefusedError):
            raise InputError(f"{label}: {problem}{where}") from None
        raise InputError(f"{label}: not YAML{where} ({problem})") from None
    except (ValueError, OverflowError) as error:
        # A date that does not exist, or a number of thousands of digits.
        raise InputError(f"{label}: a value cannot be read ({str(error).splitlines()[0]}); correct it") from None


def split_assignment(text: str, label: str, form: str, example: str) -> tuple[str, str]:
    """Split a text ``KEY=VALUE``.

    Parameters
    ----------
    text : str
        The text.
    label : str
        Beginning of a message.
    form, example : str
        Expected form and an example, for messages.

    Returns
    -------
    tuple of str
        Key, without surrounding blanks, and value.

    Raises
    ------
    InputError
        There is no equals sign, or no key.
    """
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise InputError(f"{label} {text}: write it as {form}, for example {example}")
    return key.strip(), value


def parse_value(text: str, label: str, expected: str) -> Any:
    """Parse the value that a user gives for a key, as in a settings file.

    Parameters
    ----------
    text : str
        The text.
    label : str
        Beginning of a message.
    expected : str
        End of a message, such as ``neither a number nor a word``.

    Raises
    ------
    InputError
        The text is not a valid value.
    """
    try:
        return parse_yaml(text, "")
    except InputError:
        raise InputError(f"{label}={_cut(text)}: the value is {expected}") from None


def _cut(text: str) -> str:
    return text if len(text) <= _SHORT.maxstring else f"{text[: _SHORT.maxstring]}..."


class _RefusedError(yaml.MarkedYAMLError):
    """Valid YAML that is refused."""


class _StrictLoader(yaml.SafeLoader):
    """Safe loader that limits depth and aliases and refuses duplicate keys."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._open: list[str | None] = []
        self._aliases = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent):
            self._aliases += 1
            if self._aliases > MAX_ALIASES or event.anchor in self._open:
                raise _refused(
                    f"the alias '*{event.anchor}' is not accepted: there are too many aliases, or it contains itself; "
                    "write the values out",
                    event.start_mark,
                )
            return super().compose_node(parent, index)
        if len(self._open) >= MAX_DEPTH:
            raise _refused(f"nested more than {MAX_DEPTH} levels deep; use fewer levels", event.start_mark)
        self._open.append(event.anchor)
        try:
            return super().compose_node(parent, index)
        finally:
            self._open.pop()

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: dict[str, int] = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode) or key.tag == _MERGE:
                continue
            if key.value in seen:
                problem = f"the key '{key.value}' occurs twice, first at line {seen[key.value]}; remove one"
                raise _refused(problem, key.start_mark)
            seen[key.value] = key.start_mark.line + 1
        return super().construct_mapping(node, deep)


def _refused(problem: str, mark: Any) -> _RefusedError:
    return _RefusedError(problem=problem, problem_mark=mark)


_BOUNDS = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}
"""Pydantic's kinds of faults of a number beyond a bound, the bound's name, and what the number must be."""


Model = TypeVar("Model", bound=BaseModel)


def read_model(path: Path, kind: str, model: type[Model], describe_fault: Callable[[Mapping[str, Any]], str]) -> Model:
    """Read a user's YAML file into a model.

    Parameters
    ----------
    path : Path
        The file.
    kind : str
        Kind of file in messages, such as ``alerts``.
    model : type
        Class of the result.
    describe_fault : callable
        Function that describes a fault found by pydantic in one line; it is called with the first (`first_fault`).

    Raises
    ------
    InputError
        The file cannot be read, or a key or value cannot be used.
    """
    content = parse_yaml(read_yaml_text(path, kind), str(path))
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{path}: {describe_fault(first_fault(error))}") from None


def first_fault(error: ValidationError) -> Mapping[str, Any]:
    """Return the first fault that pydantic found; an unknown key before others, as it is usually a misspelling."""
    return min(error.errors(include_url=False), key=lambda fault: fault["type"] != "extra_forbidden")


def number_rule(fault: Mapping[str, Any]) -> str:
    """Return the condition that a number refused by pydantic for `fault` must meet; empty for other faults."""
    kind = fault["type"]
    if kind in _BOUNDS:
        name, words = _BOUNDS[kind]
        return f"it must be {words} {fault['ctx'][name]:g}; correct its sign or value"
    return "it must be a finite number" if kind in {"float_type", "float_parsing", "finite_number"} else ""
