"""``gliderhpc calibrate``: a hull's trim, drag and lateral terms from its own glides, into a platform file."""

import logging
from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np
from threadpoolctl import threadpool_limits

from gliderhpc.cli import options
from gliderhpc.cli.console import results, table
from gliderhpc.cli.main import DONE
from gliderhpc.cli.platform_file import check_place, out_option, write_platform
from gliderhpc.cli.progress import logging_to
from gliderhpc.cli.text import say
from gliderhpc.errors import InputError
from gliderhpc.flight.loading import load_platform
from gliderhpc.mission.planning import select_profiles
from gliderhpc.mission.settings import build_settings_of, parse_assignments
from gliderhpc.observations import Observations, open_observations
from gliderhpc.report.calibration import (
    DIRECTIONS,
    PARAMETERS,
    SCORES,
    direction_rows,
    notes,
    parameter_rows,
    provenance,
    score_rows,
)
from gliderhpc.tuning.calibration import LEAST_PROFILES, CalibrateSettings, Calibration, calibrate
from gliderhpc.tuning.calibration_water import choose_buoyancy
from gliderhpc.tuning.records import spread_over
from gliderhpc.tuning.steady_segments import SteadySegments, steady_segments

log = logging.getLogger("gliderhpc.calibrate")

HELD_OUT = 4
"""Of how many profiles one is kept for the score where none are named."""


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
    with threadpool_limits(limits=1), logging_to(log_file), open_observations(observations) as opened:
        taken, named = chosen_profiles(opened, profiles, hold_out, settings)
        every = steady_segments(opened, platform, taken, settings, settings.steady)
        segments, apart = divided(every, named)
        platform, segments, apart = choose_buoyancy(platform, segments, apart, settings.seawater, log.info)
        log.info("calibrating on %d segments of steady flight, %d more held out", len(segments), len(apart))
        found = calibrate(platform, segments, apart, settings.calibration, log.info)
        digest = opened.digest()
    source = f"{platform.source} {provenance(found, observations.name, digest, assignments)}"
    write_platform(out, found.platform.model_copy(update={"source": source}), overwrite)
    _print(found)
    say(f"written to {out}")
    return DONE


def chosen_profiles(
    observations: Observations, profiles: str | None, hold_out: str | None, settings: CalibrateSettings
) -> tuple[list[int], list[int] | None]:
    """Profiles to take, and those of them to keep apart for the score; None where none are named."""
    available = observations.profile_numbers
    if profiles is None:
        usable = [number for number in available if number not in observations.faults]
        taken = spread_over(usable or available, settings.calibration.profiles)
    else:
        taken = list(select_profiles(available, profiles))
    if hold_out is None:
        return taken, None
    apart = list(select_profiles(available, hold_out, "--hold-out"))
    if set(taken) <= set(apart):
        raise InputError("--hold-out keeps every profile out of the fit; name fewer")
    return sorted({*taken, *apart}), apart


def divided(segments: SteadySegments, apart: Sequence[int] | None) -> tuple[SteadySegments, SteadySegments]:
    """Segments to fit and those to score: of the profiles named, or of every fourth that has steady flight."""
    if apart is None:
        flown = np.unique(segments.profile).tolist()
        apart = flown[HELD_OUT - 1 :: HELD_OUT] if len(flown) > LEAST_PROFILES else []
    held_out = np.isin(segments.profile, apart)
    return segments.of(~held_out), segments.of(held_out)


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
