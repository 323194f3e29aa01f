"""Folders of tables, figures and pages: refused before the work, and filled aside, so that no half of one is left."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from gliderhpc.errors import InputError


def check_folder(out: Path) -> None:
    """Refuse a folder that cannot be made or cannot be written to.

    Parameters
    ----------
    out : Path
        The folder, which need not exist, nor those above it.

    Raises
    ------
    InputError
        It, or what lies above it, is a file, a link to nothing, or a folder that may not be written to.
    """
    there = next(path for path in (out, *out.absolute().parents) if os.path.lexists(path))
    if not there.exists():
        raise InputError(f"{out}: cannot be written, {there} is a link to nothing; remove it or give another --out")
    if not there.is_dir():
        raise InputError(f"{out}: cannot be written, {there} is no folder; give another --out")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(f"{out}: cannot be written, the folder {there} takes no files from you; give another --out")


@contextmanager
def filled_aside(out: Path) -> Iterator[Path]:
    """Give an empty folder, whose files are moved to `out` when the block ends without an error.

    Parameters
    ----------
    out : Path
        Made where it is missing; files of the same names are replaced.

    Raises
    ------
    InputError
        As `check_folder`, or it cannot be written.
    """
    check_folder(out)
    missing = [folder for folder in (out, *out.parents) if not folder.exists()]
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out, prefix=".", suffix=".partial", ignore_cleanup_errors=True) as aside:
            yield Path(aside)
            for path in sorted(Path(aside).iterdir()):
                path.replace(out / path.name)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror or error}); give another --out") from None
    finally:
        for folder in missing:
            # One that holds something, be it anybody's, stays.
            with suppress(OSError):
                folder.rmdir()
