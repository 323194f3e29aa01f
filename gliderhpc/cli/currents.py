"""``gliderhpc currents``: depth-averaged currents from pitch, heading, depth and fixes alone."""

from pathlib import Path

import click
import numpy as np
import xarray as xr

from gliderhpc.api.currents import estimate_currents
from gliderhpc.cli.console import results, table
from gliderhpc.cli.main import DONE, FAILED
from gliderhpc.cli.messages import Verb, echo
from gliderhpc.cli.options import Finite, deployment, overwrite
from gliderhpc.output_files import check_netcdf_name, check_output, output_file
from gliderhpc.report.exports.deployment import read_deployment
from gliderhpc.wording import counted

_HEADINGS = ("profile", "start", "depth, m", "north, m/s", "east, m/s", "remark")
_WORDS = ("start", "remark")


@click.command("currents", cls=Verb)
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FILE...")
@click.argument("out", type=click.Path(path_type=Path), metavar="OUT.nc")
@click.option(
    "--platform",
    metavar="NAME_OR_FILE",
    help="Hull whose drag and lift are used.  [default: the shipped hull of the same make]",
)
@click.option(
    "--declination",
    type=Finite(-180.0, 180.0),
    help="Declination (degree, east positive), added to a magnetic heading.  [default: the one in the file]",
)
@deployment
@overwrite
def currents(
    files: tuple[Path, ...],
    out: Path,
    platform: str | None,
    declination: float | None,
    deployment: Path | None,
    overwrite: bool,
) -> int:
    """Estimate the current of every dive from pitch, heading, depth and GPS fixes alone.

    FILE is a file of pyglider, OG1 or the observation format, or any netCDF with CF names; or the glider's own files,
    which are imported first. No ballast, hull or calibration is needed, and nothing is compiled. OUT.nc contains the
    currents with their errors, and positions and speeds under water.

    \b
    Examples:
      gliderhpc currents mission_L0.nc currents.nc
      gliderhpc currents sg249/ currents.nc
      gliderhpc currents mission.nc currents.nc --platform sea035.yaml --declination 15.4
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    check_netcdf_name(out)
    check_output(out, overwrite=overwrite, inputs=files)
    stated = {} if deployment is None else read_deployment(deployment)
    estimates = estimate_currents(files, platform=platform, declination=declination, out=out).assign_attrs(stated)
    _write(estimates, out, overwrite)
    title = f"depth-averaged currents of {counted(estimates.sizes['profile'], 'profile')}"
    results().print(table(title, _rows(estimates), _HEADINGS, _WORDS))
    if estimates.attrs["comment"] != "none":
        echo(estimates.attrs["comment"])
    known = int(np.isfinite(estimates["dac_north"]).sum())
    verb = "has" if known == 1 else "have"
    echo(f"{known} of {counted(estimates.sizes['profile'], 'profile')} {verb} a current; written to {out}")
    return DONE if known else FAILED


def _write(estimates: xr.Dataset, out: Path, overwrite: bool) -> None:
    units = {"units": "seconds since 1970-01-01T00:00:00Z", "dtype": "float64", "calendar": "proleptic_gregorian"}
    # CF forbids a fill value for a coordinate (section 2.5.1), and xarray would add one.
    times = [name for name in map(str, estimates.variables) if np.issubdtype(estimates[name].dtype, np.datetime64)]
    encoding = {name: {**units, **({"_FillValue": None} if name == "time" else {})} for name in times}
    with output_file(out, overwrite=overwrite) as aside:
        estimates.to_netcdf(aside, engine="netcdf4", encoding=encoding)


def _rows(estimates: xr.Dataset) -> list[tuple[str, ...]]:
    return [
        (
            str(int(row["profile"])),
            str(row["start_time"].values.astype("datetime64[m]")).replace("T", " "),
            f"{float(row['max_depth']):.0f}",
            *(_with_error(row, name) for name in ("dac_north", "dac_east")),
            str(row["message"].values),
        )
        for row in (estimates.isel(profile=index) for index in range(estimates.sizes["profile"]))
    ]


def _with_error(row: xr.Dataset, name: str) -> str:
    value, error = float(row[name]), float(row[f"{name}_std"])
    return "-" if np.isnan(value) else f"{value:.3f} ± {error:.3f}"
