"""``gliderhpc calibrate`` and ``tune``: fit of a hull or its disturbance prior to the glider's own records."""

import logging
from pathlib import Path

import click
from rich.table import Table

from gliderhpc.calibration.dives import text as dives_text
from gliderhpc.calibration.dives.rounds import HullRounds
from gliderhpc.calibration.estimated_hulls import (
    CalibratedHull,
    HullFromDives,
    HullFromGlides,
    write_history,
    write_platform,
)
from gliderhpc.calibration.glides.fit import GlideCalibration
from gliderhpc.calibration.glides.text import (
    DIRECTIONS,
    PARAMETERS,
    SCORES,
    direction_rows,
    parameter_rows,
    score_rows,
)
from gliderhpc.calibration.prior.fit import TunedPrior, TuneSettings
from gliderhpc.calibration.prior.text import INTERPOLATED, closing_text, prior_rows, used_text, whiteness_rows
from gliderhpc.calibration.settings import CalibrateSettings
from gliderhpc.calibration.workflow import CalibrationInputs, calibrate_and_tune, calibrate_open, tune_open
from gliderhpc.cli import options
from gliderhpc.cli.console import logging_to, progress, results, table
from gliderhpc.cli.main import DONE
from gliderhpc.cli.messages import Verb, echo, warn
from gliderhpc.flight.glider import load_platform
from gliderhpc.mission.settings import build_settings_of, parse_assignments
from gliderhpc.observations import open_observations
from gliderhpc.output_files import check_output

_out = click.option(
    "--out",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.yaml",
    help="The platform file to write.",
)


@click.command("calibrate", cls=Verb)
@click.argument("observations", type=click.Path(path_type=Path))
@options.platform
@_out
@click.option(
    "--profiles", metavar="LIST", help="Profiles to use, such as 18:20,68; by default a subset across the mission."
)
@click.option(
    "--hold-out",
    metavar="LIST",
    help="Profiles held out of the fit and used only for the score; by default every fourth.",
)
@click.option(
    "--history",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.csv",
    help="With rounds over the dives: also write each dive's parameters, from all dives and from the dives up to it.",
)
@click.option(
    "--tune",
    "tunes",
    is_flag=True,
    help="Tune the disturbance prior on the calibrated hull, and calibrate again with that prior.",
)
@options.workers
@options.assignments
@options.overwrite
@options.log_file
def calibrate(
    observations: Path,
    platform_name: str,
    out: Path,
    profiles: str | None,
    hold_out: str | None,
    history: Path | None,
    tunes: bool,
    workers: int | None,
    assignments: tuple[str, ...],
    overwrite: bool,
    log_file: Path | None,
) -> int:
    """Estimate the hull from the steady glides or the whole dives of OBSERVATIONS, and write the platform.

    The fit of the steady glides estimates neutral volume, depth slope (or compressibility and thermal expansion, where
    temperature and salinity were measured), drag, lift, righting moment, battery zero, pitch moments, roll offset, and
    the lateral terms where turns determine them; each with its 95 % interval. Parameters that the glides do not
    determine are listed and held fixed: at the platform's value or, where the glides contradict that, at the most
    probable one. The errors before and after are printed for profiles held out of the fit. Nothing is written if the
    fit is worse than the platform (exit status 1).

    For hulls with fast sensors (a sample interval of at most 2 s), or with --set rounds.most=8, the hull is estimated
    in rounds over whole dives. In each round all dives are smoothed with the present hull; together they determine all
    coefficients, trim, offsets of pitch, roll and compass, and lags of the records, which give the next hull, with its
    covariance. If the last one is worse than the platform on the steady glides, or farther from it than the plausible
    deviations allow, the fit to the steady glides is written instead. --set rounds.most=0 leaves out the rounds.

    \b
    Examples:
      gliderhpc calibrate mission.nc --platform slocum --out modena.yaml
      gliderhpc calibrate m12.nc --platform seaexplorer --out sea035.yaml --profiles 38:48 --hold-out 40,44
      gliderhpc calibrate mission.nc --platform seaglider --out sg249.yaml --set calibration.hold=[K_L]
      gliderhpc calibrate mission.nc --platform slocum --out modena.yaml --set calibration.trend=true
      gliderhpc calibrate mission.nc --platform petrel-l --out hull.yaml --history hull.csv
      gliderhpc calibrate mission.nc --platform petrel-l --out hull.yaml --tune
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    values, platform_values = parse_assignments(assignments)
    settings = build_settings_of(CalibrateSettings, {}, values)
    platform = load_platform(platform_name, platform_values)
    if history is not None and settings.calibration.trend:
        raise click.UsageError(
            "--history requires rounds over the dives, which a trend excludes; leave one of them out"
        )
    if history is not None and settings.rounds.largest_number(platform) == 0:
        raise click.UsageError("--history requires rounds over the dives; add --set rounds.most=8")
    if history is not None and history.absolute() == out.absolute():
        raise click.UsageError("--out and --history name the same file; give the history another name")
    for option, file in (("--out", out), ("--history", history)):
        if file is not None:
            check_output(file, overwrite=overwrite, inputs=(observations, platform_name), instead=f"another {option}")
    with logging_to(log_file), open_observations(observations) as opened:
        calibration = calibrate_and_tune if tunes else calibrate_open
        inputs = CalibrationInputs(opened, platform, settings, profiles, hold_out, assignments)
        calibrated = calibration(inputs, options.executor_for(workers), lambda total: progress(total, "dives"))
    write_platform(out, calibrated.platform, overwrite)
    has_history = isinstance(calibrated, HullFromDives)
    if history is not None and has_history:
        write_history(history, calibrated, overwrite)
    _print_calibration(calibrated)
    if history is not None and not has_history:
        echo(f"{history} is not written: the dives gave no better hull, so there is no history", err=True)
    echo(f"written to {out}")
    return DONE


def _print_calibration(calibrated: CalibratedHull) -> None:
    for grid in _tables(calibrated):
        results().print(grid)
    rows = score_rows(calibrated.fitted, calibrated.held_out)
    results().print(table("root mean square errors of the balance", rows, SCORES, ("profiles",)))
    for line in calibrated.remarks:
        echo(line)
    for warning in calibrated.warnings:
        warn(warning)


def _tables(calibrated: CalibratedHull) -> list[Table]:
    if isinstance(calibrated, HullFromDives):
        return _dive_tables(calibrated.dives.rounds)
    assert isinstance(calibrated, HullFromGlides), "a hull from steady glides or from dives"
    return _glide_tables(calibrated.calibration)


def _glide_tables(steady: GlideCalibration) -> list[Table]:
    return [
        table("parameters, with 95 % intervals", parameter_rows(steady), PARAMETERS, ("parameter", "unit", "remark")),
        table(
            "directions of the estimated parameters, in plausible deviations",
            direction_rows(steady),
            DIRECTIONS,
            DIRECTIONS[1:],
        ),
    ]


def _dive_tables(rounds: HullRounds) -> list[Table]:
    tables = [
        table(
            "parameters, with 95 % intervals",
            dives_text.parameter_rows(rounds),
            dives_text.PARAMETERS,
            ("parameter", "unit", "remark"),
        ),
        table(
            "directions that the dives determine",
            dives_text.direction_rows(rounds),
            dives_text.DIRECTIONS,
            dives_text.DIRECTIONS[1:],
        ),
    ]
    if rounds.held_out:
        tables.append(
            table(
                "held-out dives compared with the sum of the others",
                dives_text.held_out_rows(rounds),
                dives_text.HELD_OUT,
                (),
            )
        )
    return tables


log = logging.getLogger("gliderhpc.tune")


@click.command("tune", cls=Verb)
@click.argument("observations", type=click.Path(path_type=Path))
@options.platform
@_out
@click.option(
    "--profiles",
    metavar="LIST",
    help="Profiles to tune on, such as 18:20,68; by default a subset across the mission.",
)
@options.assignments
@options.overwrite
@options.log_file
def tune(
    observations: Path,
    platform_name: str,
    out: Path,
    profiles: str | None,
    assignments: tuple[str, ...],
    overwrite: bool,
    log_file: Path | None,
) -> int:
    """Estimate the disturbance prior with the highest likelihood for OBSERVATIONS, and write the platform with it.

    The prior is the deviation and correlation time of every channel, estimated from the filter's innovations in some
    profiles. Numbers that the records do not determine keep the platform's value. A test of the innovations' whiteness
    is printed too.

    \b
    Examples:
      gliderhpc tune mission.nc --platform petrel-l --out tuned.yaml
      gliderhpc tune m12.nc --platform seaexplorer --set platform.buoyancy.neutral_volume=-215 --out sea035.yaml
      gliderhpc tune mission.nc --platform petrel-l --profiles 1:3 --set tuning.longest=3600 --out tuned.yaml
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    values, platform_values = parse_assignments(assignments)
    settings = build_settings_of(TuneSettings, {}, values)
    platform = load_platform(platform_name, platform_values)
    check_output(out, overwrite=overwrite, inputs=(observations, platform_name), instead="another `out`")
    with logging_to(log_file), open_observations(observations) as opened:
        tuned = tune_open(opened, platform, settings, profiles, assignments, log.info)
    write_platform(out, tuned.platform, overwrite)
    _print_prior(tuned.tuned, list(tuned.profiles), settings)
    for warning in tuned.warnings:
        warn(warning)
    echo(f"written to {out}")
    return DONE


def _print_prior(tuned: TunedPrior, used: list[int], settings: TuneSettings) -> None:
    console = results()
    console.print(
        table(f"disturbance prior, {used_text(used, settings)}", prior_rows(tuned), _PRIOR, _WORDS),
        table(
            "normalised innovations: white if mean 0, variance 1 and portmanteau about 1",
            whiteness_rows(tuned),
            _WHITENESS,
            _WORDS,
        ),
    )
    echo(closing_text(tuned, settings))
    if tuned.interpolated:
        echo(f"note: {INTERPOLATED}")


_PRIOR = ("channel", "quantity", "unit", "before", "after", "known to\na factor of", "remark")
_WHITENESS = ("sensor", "prior", "count", "mean", "variance", "autocorrelation", "portmanteau", "p")
_WORDS = ("channel", "quantity", "unit", "remark", "sensor", "prior")
