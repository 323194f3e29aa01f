"""``gliderhpc tune``: the disturbance prior of filter and smoother by likelihood, into a platform file."""

import logging
from pathlib import Path

import click

from gliderhpc.api.hulls import tuned_on, write_platform
from gliderhpc.cli import options
from gliderhpc.cli.console import logging_to, results, table
from gliderhpc.cli.main import DONE
from gliderhpc.cli.messages import say
from gliderhpc.cli.outputs import check_place, out_option
from gliderhpc.flight.loading import load_platform
from gliderhpc.mission.settings import build_settings_of, parse_assignments
from gliderhpc.observations import open_observations
from gliderhpc.report.tuning import INTERPOLATED, closing_text, prior_rows, used_text, whiteness_rows
from gliderhpc.tuning.disturbance_prior import TunedPrior, TuneSettings

log = logging.getLogger("gliderhpc.tune")


@click.command("tune")
@click.argument("observations", type=click.Path(path_type=Path))
@options.platform
@out_option
@click.option("--profiles", metavar="LIST", help="Profiles to tune on, such as 18:20,68; default some, spread out.")
@options.assignments
@options.overwrite
@options.log_file
def command(
    observations: Path, platform_name: str, out: Path, profiles: str | None, assignments: tuple[str, ...],
    overwrite: bool, log_file: Path | None,
) -> int:  # fmt: skip
    """Estimate the disturbance prior that makes OBSERVATIONS likeliest, and write the platform with it.

    Deviation and correlation time of every channel, from the filter's innovations on some profiles; what the records do
    not determine keeps the platform's value. The test of the innovations' whiteness is printed with it.

    \b
    Examples:
      gliderhpc tune mission.nc --platform petrel-l --out tuned.yaml
      gliderhpc tune m12.nc --platform seaexplorer --set platform.buoyancy.neutral_volume=-215 --out sea035.yaml
      gliderhpc tune mission.nc --platform petrel-l --profiles 1:3 --set tuning.longest=3600 --out tuned.yaml
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    values, platform_values = parse_assignments(assignments)
    settings = build_settings_of(TuneSettings, {}, values)
    platform = load_platform(platform_name, platform_values)
    check_place(out, overwrite, (observations, platform_name))
    with logging_to(log_file), open_observations(observations) as opened:
        found = tuned_on(opened, platform, settings, profiles, assignments, log.info)
    write_platform(out, found.platform, overwrite)
    _print(found.tuned, list(found.profiles), settings)
    say(f"written to {out}")
    return DONE


def _print(tuned: TunedPrior, used: list[int], settings: TuneSettings) -> None:
    console = results()
    console.print(
        table(f"disturbance prior, {used_text(used, settings)}", prior_rows(tuned), _PRIOR, _WORDS),
        table("normalised innovations: white if of mean 0, variance 1, portmanteau about 1", whiteness_rows(tuned),
              _WHITENESS, _WORDS),
    )  # fmt: skip
    say(closing_text(tuned, settings))
    if tuned.interpolated:
        say(f"note: {INTERPOLATED}")


_PRIOR = ("channel", "quantity", "unit", "before", "after", "known to\na factor", "remark")
_WHITENESS = ("sensor", "prior", "count", "mean", "variance", "autocorrelation", "portmanteau", "p")
_WORDS = ("channel", "quantity", "unit", "remark", "sensor", "prior")
