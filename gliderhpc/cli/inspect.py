"""``gliderhpc inspect``: checks of the records before they are inverted."""

import json
from pathlib import Path

import click

from gliderhpc.api.checks import inspected
from gliderhpc.cli import options
from gliderhpc.cli.console import logging_to, results, table
from gliderhpc.cli.main import DONE
from gliderhpc.cli.messages import say
from gliderhpc.flight.loading import load_platform
from gliderhpc.mission.settings import build_settings, parse_assignments
from gliderhpc.observations import open_observations
from gliderhpc.output_files import check_output, write_text
from gliderhpc.report.record_checks import HEADINGS, content, finding_row
from gliderhpc.tuning.record_checks import Inspection

_SHOWN_FAILURES = 10
_WORDS = ("check", "quantity", "unit", "verdict")


@click.command("inspect")
@click.argument("observations", type=click.Path(path_type=Path))
@options.platform
@options.profiles
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE.json", help="Also write JSON.")
@options.assignments
@options.overwrite
@options.log_file
def command(
    observations: Path, platform_name: str, profiles: str | None, out: Path | None, assignments: tuple[str, ...],
    overwrite: bool, log_file: Path | None,
) -> int:  # fmt: skip
    """Check the records of OBSERVATIONS: lag of depth behind attitude, offset and scale of the pitch, compass.

    Each with its size, standard error and what would correct it. Nothing is corrected: give run-mission the setting
    that is suggested. Calibrate the hull first.

    \b
    Examples:
      gliderhpc inspect mission.nc --platform sea035.yaml
      gliderhpc inspect mission.nc --platform sea035.yaml --out checks.json --set inspect.profiles=200
      gliderhpc inspect mission.nc --platform sea035.yaml --set records.pitch_offset=0.9
      gliderhpc inspect mission.nc --platform sea035.yaml --set records.pitch_scale=0.86
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    values, platform_values = parse_assignments(assignments)
    settings = build_settings({}, values)
    platform = load_platform(platform_name, platform_values)
    if out is not None:
        check_output(out, overwrite=overwrite, inputs=(observations, platform_name), instead="another --out")
    with logging_to(log_file), open_observations(observations) as opened:
        found = inspected(opened, platform, settings, profiles)
    _print(found)
    if out is not None:
        write_text(out, json.dumps(content(found), indent=2) + "\n", overwrite=overwrite)
        say(f"written to {out}")
    return DONE


def _print(found: Inspection) -> None:
    for number, why in list(found.left_out.items())[:_SHOWN_FAILURES]:
        say(f"profile {number} left out: {why}")
    rows = [finding_row(finding)[:7] for finding in found.findings]
    results().print(table(f"records of {len(found.profiles)} profiles", rows, HEADINGS[:7], _WORDS))
    for finding in found.findings:
        say(f"{finding.quantity}: {finding.remark}")
    for finding in found.found:
        say(f"suggested for {finding.quantity}: {finding.suggestion}")
