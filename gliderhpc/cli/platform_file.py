"""The platform file that a verb writes: refused before the work where it could not be, written whole or not at all."""

import os
from pathlib import Path

import click

from gliderhpc.errors import CalibrationError, InputError
from gliderhpc.flight.loading import load_platform
from gliderhpc.platform import Platform, platform_yaml

out_option = click.option(
    "--out", required=True, type=click.Path(dir_okay=False, path_type=Path), metavar="FILE.yaml",
    help="The platform file to write.",
)  # fmt: skip
overwrite_option = click.option("--overwrite", is_flag=True, help="Replace a file that exists.")


def check_place(out: Path, overwrite: bool) -> None:
    """Refuse before the work what could not be written after it."""
    if out.exists() and not overwrite:
        raise InputError(f"{out}: this file exists; give another --out or replace it with --overwrite")
    if not out.resolve().parent.is_dir():
        raise InputError(f"{out}: there is no folder {out.resolve().parent}; make it or give another --out")
    if not os.access(out if out.exists() else out.resolve().parent, os.W_OK):
        raise InputError(f"{out}: cannot be written; give another --out")


def write_platform(out: Path, platform: Platform) -> None:
    """Write a whole file or none: one that loads again, as `run-mission` will load it.

    Raises
    ------
    CalibrationError
        The file would be refused.
    """
    part = out.with_name(f"{out.name}.part")
    part.write_text(platform_yaml(platform), "utf-8")
    try:
        load_platform(part)
    except InputError as error:
        part.unlink()
        raise CalibrationError(
            f"the platform found could not be used, so nothing is written: {str(error).removeprefix(f'{part}: ')}; "
            "start from another --platform or choose other --profiles"
        ) from None
    part.replace(out)
