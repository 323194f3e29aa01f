"""Documentation: it builds without a warning, fetches nothing, and its instructions work."""

import inspect
import os
import pydoc
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest
import yaml
from support.forked_program import UNDRAWN, forked_program
from support.object_stores import KEYS, make_bucket, s3_server
from support.pages import DOCS, blocks_of, run_page
from support.repository import REPOSITORY

import gliderhpc

pytestmark = pytest.mark.compiled

NAVIGATION = yaml.safe_load((REPOSITORY / "mkdocs.yml").read_text("utf-8"))["nav"]

TUTORIALS = ("tutorials/synthetic.md", "tutorials/real.md")
HOW_TO = (*(f"how-to/{path.name}" for path in sorted((DOCS / "how-to").glob("*.md"))), "clusters.md")

PLAIN = (
    "tutorials/synthetic.md", "how-to/platform.md", "how-to/calibrate.md", "how-to/queries.md", "how-to/instrument.md",
    "how-to/python.md", "how-to/watch.md", "clusters.md",
)  # fmt: skip
"""Pages that need nothing but the program."""

NOT_RUN = {
    "tutorials/real.md": 1,  # where the reader keeps the files
    "how-to/object-store.md": 1,  # the reader's keys
    "clusters.md": 2,  # SLURM
}
"""Number of blocks of a page that cannot be run; they must stay few."""


@pytest.fixture(scope="module")
def commands(tmp_path_factory):
    """Folder of a `gliderhpc` that starts at once."""
    with forked_program(tmp_path_factory.mktemp("program")) as folder:
        yield folder


@pytest.mark.parametrize(
    "page", [REPOSITORY / "README.md", *(DOCS / "how-to").glob("*.md")], ids=lambda page: page.name
)
def test_the_current_of_examples_is_the_adopted_one(page):
    """Reports and exports give the smoother's; a reader of `dac_north` compared another one with them."""
    text = page.read_text("utf-8")
    read = (
        set(re.findall(r"""["']dac_(?:north|east)["']""", text)) if "open_mission" in text or "datatree" in text else ()
    )
    assert not read


@pytest.mark.long
@pytest.mark.parametrize("page", PLAIN)
def test_a_page_does_what_it_says(page, commands, tmp_path):
    """The figures of the first tutorial are drawn; those of other pages are made by the same functions."""
    run_page(DOCS / page, tmp_path, commands, **{} if page == TUTORIALS[0] else {UNDRAWN: "yes"})


@pytest.mark.long
def test_the_tutorial_on_a_real_mission(shared_data, commands, tmp_path):
    run_page(DOCS / "tutorials" / "real.md", tmp_path, commands, GLIDER_DATA=str(shared_data), **{UNDRAWN: "yes"})


@pytest.mark.long
def test_the_object_store_page(commands, tmp_path):
    with s3_server(tmp_path) as server:
        bucket = make_bucket(server, "pages")
        environment = {**KEYS, "AWS_ENDPOINT_URL": server, "BUCKET": bucket}
        run_page(DOCS / "how-to" / "object-store.md", tmp_path, commands, **environment)


@pytest.mark.long
def test_a_study_is_added_as_the_page_says(brief_store, tmp_path):
    """On a copy of the source, whose kernels are compiled already: the folder follows the sources, not their place."""
    source = Path(gliderhpc.__file__).parent
    shutil.copytree(source, tmp_path / "gliderhpc", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(brief_store, tmp_path / "mission.zarr")
    run_page(DOCS / "how-to" / "study.md", tmp_path, PYTHONPATH=str(tmp_path))


def test_every_tutorial_and_how_to_page_is_run():
    special = {"tutorials/real.md", "how-to/object-store.md", "how-to/study.md"}
    assert {*TUTORIALS, *HOW_TO} == {*PLAIN, *special}
    (tutorials,), (how_to,) = ([s[name] for s in NAVIGATION if name in s] for name in ("Tutorials", "How to"))
    assert [page for entry in tutorials for page in entry.values()] == list(TUTORIALS)
    assert sorted(page for entry in how_to for page in entry.values()) == sorted(HOW_TO)


def test_a_block_that_fails_is_named(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("Text.\n\n```bash\nexport WHO=me\n```\n\n```bash\ntest $WHO = me\nfalse\ntrue\n```\n")
    with pytest.raises(AssertionError, match="line 7: exit status 1"):
        run_page(page, tmp_path)
    page.write_text('```text title="creates"\nnothing.nc\n```\n')
    with pytest.raises(AssertionError, match=r"line 1: not there: nothing\.nc"):
        run_page(page, tmp_path)


def test_blocks_that_cannot_be_run_say_why_and_stay_few():
    found = {}
    for page in (*TUTORIALS, *HOW_TO):
        reasons = [block.reason for block in blocks_of(DOCS / page) if block.title.startswith("not run")]
        assert all(len(reason) > 10 for reason in reasons), page
        if reasons:
            found[page] = len(reasons)
    assert found == NOT_RUN


# The site


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, built as `make docs` does."""
    pytest.importorskip("mkdocs", reason="the extra 'docs' is not installed")
    pytest.importorskip("mkdocstrings", reason="the extra 'docs' is not installed")
    folder, shadows = tmp_path_factory.mktemp("site"), tmp_path_factory.mktemp("shadows")
    # The environment of `make docs` has no ruff; where there is one, it would start for each of 600 signatures.
    (shadows / "ruff.py").touch()
    # Searching for garbage takes a tenth of the time with Python's own threshold.
    (shadows / "sitecustomize.py").write_text("import gc\n\ngc.set_threshold(100_000)\n", "utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
        cwd=REPOSITORY, env={**os.environ, "NO_MKDOCS_2_WARNING": "1", "PYTHONPATH": f"{shadows}:{REPOSITORY}"},
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-5000:]
    assert "WARNING" not in done.stderr, done.stderr
    return folder


class _Fetched(HTMLParser):
    """Collects what a browser fetches by itself when it opens a page."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = dict(attrs)
        if tag in ("script", "img", "iframe", "source", "video", "embed"):
            self.addresses.append(named.get("src") or "")
        if tag == "link" and named.get("rel") not in ("canonical", "next", "prev"):
            self.addresses.append(named.get("href") or "")


def test_no_page_fetches_anything_from_elsewhere(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 40
    for page in pages:
        parser = _Fetched()
        parser.feed(page.read_text("utf-8"))
        assert parser.addresses
        assert not [address for address in parser.addresses if re.match(r"(https?:)?//", address)], page
    for sheet in site.rglob("*.css"):
        assert not re.findall(r"url\(\s*[\"']?(?:https?:)?//[^)]*\)", sheet.read_text("utf-8")), sheet


def test_the_reference_of_python_has_every_name_that_the_package_offers(site):
    headings = re.findall(r'<h\d id="(gliderhpc\.[\w.]+)"', (site / "reference" / "api.html").read_text("utf-8"))
    objects = [inspect.unwrap(pydoc.locate(name)) for name in headings]
    for name in set(gliderhpc.__all__) - {"__version__", "report"}:
        offered = getattr(gliderhpc, name)
        assert inspect.unwrap(offered) in objects, name
    assert "gliderhpc.report.page.report.write_report" in headings
    functions = {"findings": "findings.results.write_findings", "report": "report.studies.show_study"}
    for page, function in functions.items():
        assert f'id="gliderhpc.{function}"' in (site / "reference" / f"{page}.html").read_text("utf-8")


def test_the_generated_pages_hold_what_they_are_made_from(site):
    commands = (site / "reference" / "cli.html").read_text("utf-8")
    settings = (site / "reference" / "settings.html").read_text("utf-8")
    for words in ("gliderhpc run-mission", "--worker-timeout", "gliderhpc import slocum", "gliderhpc twin currents"):
        assert words in commands
    for words in ("window.length", "smoother.degrees_of_freedom", "currents.largest_doubt", "gusts.kind"):
        assert words in settings
    assert "Measured on" in (site / "performance.html").read_text("utf-8")
    assert (site / "examples" / "slurm.sh").is_file()


def test_the_tests_that_the_reliability_page_names_exist():
    named = set(re.findall(r"`(test_\w+\.py)`", (DOCS / "reliability.md").read_text("utf-8")))
    assert len(named) > 30
    assert named <= {path.name for path in (REPOSITORY / "tests").rglob("test_*.py")}
