"""Exports of an archive: check of the output file, and excluded profiles."""

from pathlib import Path

from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError
from gliderhpc.output_files import check_netcdf_name, check_output
from gliderhpc.store_schema import STATUS
from gliderhpc.store_schema.location import Location
from gliderhpc.wording import counted


def check_export_path(archive: Location, out: Path, overwrite: bool) -> None:
    """Refuse a file that cannot be written, exists already, or is inside the archive.

    Raises
    ------
    InputError
        The file is a folder, cannot be written, exists and `overwrite` is not set, or lies inside the archive.
    """
    if out.is_dir():
        raise InputError(f"{out}: is a folder; the last argument is the netCDF file to write, for example results.nc")
    check_netcdf_name(out)
    check_output(out, overwrite=overwrite, inputs=(archive,))


def unfit_profiles(archive: Location, tree: Archive) -> dict[int, str]:
    """Return the failed profiles with their messages.

    Raises
    ------
    InputError
        Profiles of the archive are still pending.
    """
    table = tree.to_dataset()
    states = {int(n): str(s) for n, s in zip(table["profile"].values, table["status"].values, strict=True)}
    pending = sum(status == STATUS[0] for status in states.values())
    if pending:
        verb = "is" if pending == 1 else "are"
        raise InputError(
            f"{archive}: unfinished, {pending} of {counted(len(states), 'profile')} {verb} still to be done; finish it "
            "with `gliderhpc run-mission --resume`"
        )
    messages = dict(zip(states, map(str, table["message"].values), strict=True))
    return {number: messages[number] for number, status in states.items() if status == "failed"}
