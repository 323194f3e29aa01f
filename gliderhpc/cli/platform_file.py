"""The platform file that a verb writes: refused before the work where it could not be, written whole or not at all."""

from collections.abc import Iterable
from pathlib import Path

import click

from gliderhpc.errors import CalibrationError, InputError
from gliderhpc.flight.loading import load_platform
from gliderhpc.output_file import check_output, written_aside
from gliderhpc.platform import Platform, platform_yaml

out_option = click.option(
    "--out", required=True, type=click.Path(dir_okay=False, path_type=Path), metavar="FILE.yaml",
    help="The platform file to write.",
)  # fmt: skip


def check_place(out: Path, overwrite: bool, inputs: Iterable[Path | str] = ()) -> None:
    """Refuse before the work what could not be written after it."""
    check_output(out, overwrite=overwrite, inputs=inputs, instead="another --out")


def write_platform(out: Path, platform: Platform, overwrite: bool) -> None:
    """Write a whole file or none: one that loads again, as `run-mission` will load it.

    Raises
    ------
    CalibrationError
        The file would be refused.
    InputError
        It cannot be written.
    """
    try:
        with written_aside(out, overwrite=overwrite) as aside:
            aside.write_text(platform_yaml(platform), "utf-8")
            _check_loads(aside)
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror or error}") from error


def _check_loads(aside: Path) -> None:
    try:
        load_platform(aside)
    except InputError as error:
        raise CalibrationError(
            f"the platform found could not be used, so nothing is written: {str(error).removeprefix(f'{aside}: ')}; "
            "start from another --platform or choose other --profiles"
        ) from None
