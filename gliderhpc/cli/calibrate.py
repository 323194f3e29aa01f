"""``gliderhpc calibrate``: a hull's trim, drag and lateral terms from its own glides, into a platform file."""

from pathlib import Path

import click

from gliderhpc.api.hulls import calibrated_on, write_platform
from gliderhpc.cli import options
from gliderhpc.cli.console import logging_to, results, table
from gliderhpc.cli.main import DONE
from gliderhpc.cli.messages import say
from gliderhpc.cli.outputs import check_place, out_option
from gliderhpc.flight.loading import load_platform
from gliderhpc.mission.settings import build_settings_of, parse_assignments
from gliderhpc.observations import open_observations
from gliderhpc.report.calibration import (
    DIRECTIONS,
    PARAMETERS,
    SCORES,
    direction_rows,
    notes,
    parameter_rows,
    score_rows,
)
from gliderhpc.tuning.calibration import CalibrateSettings, Calibration


@click.command("calibrate")
@click.argument("observations", type=click.Path(path_type=Path))
@options.platform
@out_option
@click.option("--profiles", metavar="LIST", help="Profiles to take, such as 18:20,68; default some, spread out.")
@click.option(
    "--hold-out", metavar="LIST",
    help="Profiles kept out of the fit, for the score alone; default every fourth of those taken.",
)  # fmt: skip
@options.assignments
@options.overwrite
@options.log_file
def command(
    observations: Path, platform_name: str, out: Path, profiles: str | None, hold_out: str | None,
    assignments: tuple[str, ...], overwrite: bool, log_file: Path | None,
) -> int:  # fmt: skip
    """Fit the trim, drag and lateral terms that the steady glides of OBSERVATIONS determine, and write the platform.

    Neutral volume, depth slope (or compressibility and thermal expansion, where temperature and salinity were
    measured), drag, lift, righting moment, battery zero, pitch moments, roll offset, and the lateral
    terms where turns tell them; each with its 95 % interval. What the glides do not determine is held and named: at
    the platform's value, or at the most probable one where they refute that. The errors before and after are printed
    for profiles that were kept out of the fit. A fit worse than its start writes nothing (exit status 1).

    \b
    Examples:
      gliderhpc calibrate mission.nc --platform slocum --out modena.yaml
      gliderhpc calibrate m12.nc --platform seaexplorer --out sea035.yaml --profiles 38:48 --hold-out 40,44
      gliderhpc calibrate mission.nc --platform seaglider --out sg249.yaml --set calibration.hold=[K_L]
      gliderhpc calibrate mission.nc --platform slocum --out modena.yaml --set calibration.trend=true
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    values, platform_values = parse_assignments(assignments)
    settings = build_settings_of(CalibrateSettings, {}, values)
    platform = load_platform(platform_name, platform_values)
    check_place(out, overwrite, (observations, platform_name))
    with logging_to(log_file), open_observations(observations) as opened:
        found = calibrated_on(opened, platform, settings, profiles, hold_out, assignments)
    write_platform(out, found.platform, overwrite)
    _print(found.calibration)
    say(f"written to {out}")
    return DONE


def _print(found: Calibration) -> None:
    results().print(
        table("parameters, with 95 % intervals", parameter_rows(found), PARAMETERS, ("parameter", "unit", "remark")),
        table(
            "directions of those estimated, in plausible deviations", direction_rows(found), DIRECTIONS, DIRECTIONS[1:]
        ),
        table("errors of the balance, root mean square", score_rows(found), SCORES, ("profiles",)),
    )
    for line in notes(found):
        say(line)
