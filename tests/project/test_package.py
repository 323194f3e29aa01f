"""Wheel and source archive: built, inspected, and run from a separate folder."""

import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile

import pytest
import yaml
from support.repository import REPOSITORY

pytest.importorskip("build", reason="the extra 'dev' is not installed")
pytest.importorskip("hatchling", reason="hatchling is not installed")

PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text("utf-8"))["project"]
VERSION = PROJECT["version"]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Folder with the wheel and the source archive."""
    folder = tmp_path_factory.mktemp("dist")
    subprocess.run(
        [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(REPOSITORY)],
        check=True, capture_output=True, timeout=300,
    )  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def wheel(built):
    return built / f"gliderhpc-{VERSION}-py3-none-any.whl"


def test_the_wheel_holds_the_package_once_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as opened:
        names = opened.namelist()
    assert {name.split("/")[0] for name in names} == {"gliderhpc", f"gliderhpc-{VERSION}.dist-info"}
    assert len(names) == len(set(names))
    source = {
        path.relative_to(REPOSITORY).as_posix()
        for path in (REPOSITORY / "gliderhpc").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and path.suffix != ".so"
    }
    assert {name for name in names if name.startswith("gliderhpc/")} == source
    assert {"gliderhpc/py.typed", "gliderhpc/platforms/petrel-l.yaml", "gliderhpc/store_schema/mission.txt"} <= source
    assert any(name.startswith("gliderhpc/simulator/scenarios/") for name in names)


def _pins(file):
    lines = (REPOSITORY / file).read_text("utf-8").splitlines()
    pins = [line.partition(";")[0].strip().partition("==")[::2] for line in lines if not line.startswith("#")]
    return {name.lower().replace("_", "-"): version for name, version in pins}


def test_the_lowest_versions_are_those_that_the_project_allows():
    allowed = [re.fullmatch(r"([\w.-]+)>=([\d.]+)", text).groups() for text in PROJECT["dependencies"]]
    assert _pins("constraints-lowest.txt") == {name.lower(): version for name, version in allowed}


def test_the_development_versions_cover_every_dependency():
    extras = PROJECT["optional-dependencies"]
    wanted = [*PROJECT["dependencies"], *extras["dev"], *extras["docs"]]
    names = {re.match(r"[\w.-]+", text)[0].lower() for text in wanted}
    assert names <= set(_pins("constraints-dev.txt"))


CONDA_NAMES = {"arch": "arch-py", "dask": "dask-core", "matplotlib": "matplotlib-base"}
"""Names on conda-forge that differ from those on the Python package index."""


def test_the_conda_recipe_states_the_projects_requirements():
    recipe = yaml.safe_load((REPOSITORY / "packaging" / "conda" / "recipe.yaml").read_text("utf-8"))
    assert recipe["context"]["version"] == VERSION
    split = [re.fullmatch(r"([\w.-]+)(>=[\d.]+)", text).groups() for text in PROJECT["dependencies"]]
    wanted = {f"{CONDA_NAMES.get(name.lower(), name.lower())} {version}" for name, version in split}
    python, *packages = recipe["requirements"]["run"]
    assert set(packages) == wanted
    low, _, high = PROJECT["requires-python"].removeprefix(">=").partition(",<")
    assert python == f"python >=${{{{ python_min }}}},<{high}"
    assert recipe["context"]["python_min"] == low
    (name, target), *_ = PROJECT["scripts"].items()
    assert recipe["build"]["python"]["entry_points"] == [f"{name} = {target}"]


def test_the_images_copy_what_the_wheel_is_built_from():
    """A container's build stage has the files that it copies and no others."""
    lines = (REPOSITORY / "packaging" / "Containerfile").read_text("utf-8").splitlines()
    copied = {
        file for line in lines if line.startswith("COPY ") and "--from" not in line for file in line.split()[1:-1]
    }
    recipe = (REPOSITORY / "packaging" / "gliderhpc.def").read_text("utf-8")
    placed = re.search(r"%files\n(.+?)\n\n", recipe, re.DOTALL)[1]
    assert {line.split()[0] for line in placed.splitlines()} == copied
    assert all((REPOSITORY / name).exists() for name in copied)
    needed = {PROJECT["readme"], *PROJECT["license-files"], "pyproject.toml", "hatch_build.py", "gliderhpc"}
    assert needed < copied


def test_the_source_archive_can_be_tested_and_documented(built):
    with tarfile.open(built / f"gliderhpc-{VERSION}.tar.gz") as opened:
        names = {name.partition("/")[2] for name in opened.getnames()}
        links = [member.name for member in opened.getmembers() if member.issym() or member.islnk()]
    assert {"pyproject.toml", "README.md", "CHANGELOG.md", "LICENSE", "Makefile", "mkdocs.yml"} <= names
    assert {"CITATION.cff", "CONTRIBUTING.md", "notebooks/real_mission.ipynb", "constraints-lowest.txt"} <= names
    assert {"tests/conftest.py", "docs/index.md", "benchmarks/results.json", "examples/slurm.sh"} <= names
    assert not links
    assert not {name for name in names if name.split("/")[0] in ("kernels", "cli", "store_schema", "site", ".venv")}


def test_the_metadata(wheel):
    with zipfile.ZipFile(wheel) as opened:
        text = opened.read(f"gliderhpc-{VERSION}.dist-info/METADATA").decode()
        scripts = opened.read(f"gliderhpc-{VERSION}.dist-info/entry_points.txt").decode()
    assert f"Version: {VERSION}" in text
    assert "License-Expression: Apache-2.0" in text
    assert "gliderhpc = gliderhpc.cli:main" in scripts
    for extra in PROJECT["optional-dependencies"]:
        assert f"Provides-Extra: {extra}" in text


def test_the_wheel_runs_where_it_is_installed(wheel, tmp_path):
    """Without its dependencies, which are those of this environment."""
    target = tmp_path / "lib"
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(target), str(wheel)],
        check=True, capture_output=True, timeout=300,
    )  # fmt: skip

    def output_of(*arguments):
        return subprocess.run(
            [sys.executable, "-m", "gliderhpc", *arguments],
            cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(target)}, check=True, capture_output=True, text=True,
        ).stdout  # fmt: skip

    assert output_of("--version") == f"gliderhpc, version {VERSION}\n"
    assert "petrel-l" in output_of("platforms")


def test_the_changelog_has_the_version():
    headings = re.findall(r"^## (.+)$", (REPOSITORY / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert headings[0] == "Unreleased"
    assert headings[1].split()[0] == VERSION


def test_the_citation_names_this_version_and_the_paper():
    citation = yaml.safe_load((REPOSITORY / "CITATION.cff").read_text("utf-8"))
    assert citation["version"] == VERSION
    title = re.findall(r'"(.+)"', citation["message"])[0]
    for page in ("README.md", "docs/index.md", "docs/theory/index.md", "docs/theory/equations.md"):
        assert title in " ".join((REPOSITORY / page).read_text("utf-8").split()), page


def test_one_range_of_python_versions_is_named():
    """The metadata, the check in the Makefile, its message and the pages name the same range."""
    low, high = re.fullmatch(r">=3\.(\d+),<3\.(\d+)", PROJECT["requires-python"]).groups()
    last = int(high) - 1
    assert f"(3, {low}) <= v <= (3, {last})" in (REPOSITORY / "Makefile").read_text("utf-8")
    for page in ("Makefile", "README.md", "CONTRIBUTING.md", "docs/index.md"):
        assert f"Python 3.{low} to 3.{last}" in (REPOSITORY / page).read_text("utf-8"), page
    assert f"Programming Language :: Python :: 3.{last}" in PROJECT["classifiers"]
