"""Page that links the paper's equations to functions and tests, and the names cited in pages and docstrings."""

import ast
import importlib
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.repository import REPOSITORY

PAGE = REPOSITORY / "docs" / "theory" / "equations.md"
ROWS = re.findall(r"^\| (\d+) \| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", PAGE.read_text("utf-8"), re.MULTILINE)
LAST = 41

_CITATION = re.compile(r"(?<![a-z])(?:eqs?\.|equations?)[ _](\d+(?:(?:-|, | and | to |_and_)\d+)*)", re.IGNORECASE)


def cited_equations(text: str) -> set[int]:
    """Numbers of the equations that a text cites, such as "eqs. 1-14, 20 and 28"."""
    numbers: set[int] = set()
    for citation in _CITATION.findall(text):
        for part in re.split(r", | and |_and_", citation):
            first, _, last = part.replace(" to ", "-").partition("-")
            numbers |= set(range(int(first), int(last or first) + 1))
    return numbers


def test_citations_are_read():
    assert cited_equations("eqs. 1-3, 20 and 28") == {1, 2, 3, 20, 28}
    assert cited_equations("Eqs. 29 to 31, where") == {29, 30, 31}
    assert cited_equations("test_equations_39_and_40_by_hand") == {39, 40}
    assert cited_equations("eq. 38, Algorithm 1") == {38}


def test_every_equation_has_one_row():
    assert [int(number) for number, *_ in ROWS] == list(range(1, LAST + 1))


@pytest.mark.parametrize(("function", "number"), [(function, number) for number, _, function, _ in ROWS])
def test_the_functions_exist(function, number):
    paths = re.findall(r"\[`([\w.]+)`\]\[gliderhpc\.([\w.]+)\]", function)
    assert paths or function == "the same"
    for shown, path in paths:
        assert shown == path
        assert find_object(f"gliderhpc.{path}") is not None, f"equation {number}: {path}"


def find_object(path: str) -> object | None:
    """Object of a dotted path: a module, an attribute of one, or an attribute of one of its classes."""
    parts = path.split(".")
    for length in range(len(parts), 0, -1):
        try:
            found: object | None = importlib.import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for name in parts[length:]:
            found = getattr(found, name, None)
        return found
    return None


@pytest.mark.parametrize(("test", "number"), [(test, int(number)) for number, *_, test in ROWS])
def test_the_tests_exist_and_cite_their_equation(test, number):
    file, name = test.strip("`").split("::")
    (path,) = (REPOSITORY / "tests").glob(f"*/{file}")
    module = ast.parse(path.read_text("utf-8"))
    functions = [node for node in module.body if isinstance(node, ast.FunctionDef) and node.name == name]
    assert len(functions) == 1, f"{file} has no {name}"
    text = " ".join([name, ast.get_docstring(functions[0]) or "", ast.get_docstring(module) or ""])
    assert number in cited_equations(text)


# Names that pages and docstrings cite

PAGES = [*sorted((REPOSITORY / "docs").rglob("*.md")), REPOSITORY / "README.md", REPOSITORY / "CONTRIBUTING.md"]


def prose_of(page: Path) -> str:
    """Text of a page without its blocks of code, which other tests run."""
    return re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)


def test_the_modules_that_pages_name_exist():
    named = {
        (name, page.name)
        for page in PAGES
        for name in re.findall(r"(?<![\w./-])gliderhpc(?:\.[A-Za-z_]\w*)+", prose_of(page))
    }
    assert len(named) > 50
    assert {(name, page) for name, page in named if find_object(name) is None} == set()


def docstrings_of(path: Path) -> Iterator[str]:
    """Docstrings of a module, of its classes and functions, and of its constants."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.value.value


@pytest.mark.parametrize("folder", ["gliderhpc", "tests", "benchmarks"])
def test_docstrings_cite_files_of_the_repository_only(folder):
    found = [
        path
        for pattern in ("*.md", "docs/**/*.md", "benchmarks/*.md", "gliderhpc/**/*.txt")
        for path in REPOSITORY.glob(pattern)
    ]
    pages = {path.relative_to(REPOSITORY).as_posix() for path in found}
    cited = {
        (name, path.relative_to(REPOSITORY).as_posix())
        for path in (REPOSITORY / folder).rglob("*.py")
        for text in docstrings_of(path)
        for name in re.findall(r"(?<![\w/{])[\w/-]+\.(?:md|txt)\b", text)
    }
    lacking = {(name, path) for name, path in cited if not any(page.endswith(name) for page in pages)}
    assert lacking == set()
