"""Documentation pages as programs: their code blocks, in order, run in a separate folder."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from support.repository import REPOSITORY

DOCS = REPOSITORY / "docs"

NOT_RUN = "not run: "
"""Beginning of the title of a block that cannot be run; the reason follows."""

CREATES = "creates"
"""Title of a block of text that names files, one a line, which must be there."""

FILES = ("bash", "python", "yaml", "diff")
"""Languages of blocks with a file's name as their title: the file is written, or patched by a diff."""

LONGEST = 600.0
"""Seconds that a block may take."""

_FENCE = re.compile(r"^( *)```(\w*)(?: title=\"([^\"]*)\")?[^\n]*\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)

_KEEP = ".environment"
"""Exports of a bash block are there for the next."""


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its title, its text, and the line of the page that it begins on."""

    language: str
    title: str
    text: str
    line: int

    @property
    def reason(self) -> str:
        """Reason for which it is not run, empty where it is."""
        return self.title.removeprefix(NOT_RUN) if self.title.startswith(NOT_RUN) else ""


def blocks_of(page: Path) -> list[Block]:
    """Fenced blocks of a page, in order."""
    text = page.read_text("utf-8")
    return [
        Block(language, title, _dedented(body, len(indent)), text[: found.start()].count("\n") + 1)
        for found in _FENCE.finditer(text)
        for indent, language, title, body in [found.groups(default="")]
    ]


def run_page(page: Path, folder: Path, commands: Path | None = None, **environment: str) -> None:
    """Run a page's blocks in a folder, each according to its language and title; the first that fails is named.

    Commands are looked for in ``commands`` first, then where this Python's are.

    Raises
    ------
    AssertionError
        A block ended with another exit status than 0, or a file that the page names is not there.
    """
    search = os.pathsep.join(
        [*([str(commands)] if commands else []), str(Path(sys.executable).parent), os.environ["PATH"]]
    )
    known = {
        **os.environ, "PATH": search, "PYTHONPATH": str(REPOSITORY), "OMP_NUM_THREADS": "1", "COLUMNS": "120",
        **environment,
    }  # fmt: skip
    for block in blocks_of(page):
        if not block.reason:
            _do(block, f"{page.name}, line {block.line}", folder, known)


def _do(block: Block, where: str, folder: Path, environment: dict[str, str]) -> None:
    if block.language == "text":
        _hold_to_its_files(block, where, folder)
    elif block.title:
        _write(block, folder / block.title)
    elif block.language == "bash":
        _run(["bash", "-c", _remembering(block.text)], where, folder, environment)
    elif block.language == "python":
        _run(["python", "-c", block.text], where, folder, environment)
    else:
        raise AssertionError(f"{where}: a block of '{block.language}' without a title says nothing to do")


def _hold_to_its_files(block: Block, where: str, folder: Path) -> None:
    if block.title == CREATES:
        lacking = [name for name in block.text.split("\n") if name and not (folder / name).exists()]
        assert not lacking, f"{where}: not there: {', '.join(lacking)}"


def _write(block: Block, path: Path) -> None:
    if block.language == "diff":
        done = subprocess.run(["patch", str(path)], input=block.text, text=True, capture_output=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return
    assert block.language in FILES, block
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(block.text, "utf-8")


def _remembering(text: str) -> str:
    """Stop at the first command that fails, and pass on exported variables."""
    return f"set -euo pipefail\n[ ! -f {_KEEP} ] || . ./{_KEEP}\n{text}\nexport -p > {_KEEP}\n"


def _run(command: list[str], where: str, folder: Path, environment: dict[str, str]) -> None:
    """Run a command to its end, and end with it whatever it left in the background."""
    with tempfile.TemporaryFile("w+") as output:
        process = subprocess.Popen(
            command, cwd=folder, env=environment, stdout=output, stderr=output, stdin=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip
        try:
            status = process.wait(timeout=LONGEST)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
        output.seek(0)
        assert status == 0, f"{where}: exit status {status}\n{output.read()[-5000:]}"


def _dedented(text: str, indent: int) -> str:
    return "".join(line[indent:] if line.strip() else line for line in text.splitlines(keepends=True))
