"""``gliderhpc doctor``: checks of a run's requirements on this machine."""

from collections.abc import Sequence
from pathlib import Path

import click

from gliderhpc.cli import options
from gliderhpc.cli.main import DONE, FAILED
from gliderhpc.cli.messages import Verb, echo
from gliderhpc.mission.doctor import Check, State, examine
from gliderhpc.store_schema.location import Location


@click.command("doctor", cls=Verb)
@click.option(
    "--store",
    type=options.PLACE,
    default=Path(),
    show_default="this folder",
    help="Location for archives: a folder, or s3://BUCKET/FOLDER.",
)
@options.scheduler_option
@options.scheduler_file_option
def doctor(store: Location, scheduler: str | None, scheduler_file: Path | None) -> int:
    """Check a run's requirements: versions, processor, compiled kernels, write access, disk, a cluster, extras.

    Exit status 1: something that a run needs is missing; its line names the remedy. Items marked absent are optional.

    \b
    Examples:
      gliderhpc doctor
      gliderhpc doctor --store /scratch/missions --scheduler-file scheduler.json
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    checks = list(examine(store, options.cluster_address(scheduler, scheduler_file)))
    for line in format_checks(checks):
        echo(line)
    missing = [check.name for check in checks if check.state is State.MISSING]
    echo(f"missing: {', '.join(missing)}" if missing else "everything that a run needs is available")
    return FAILED if missing else DONE


def format_checks(checks: Sequence[Check]) -> list[str]:
    """Return aligned lines: name, state, finding and remedy."""
    name = max(len(check.name) for check in checks)
    state = max(len(check.state.value) for check in checks)
    return [
        f"{check.name:{name}}  {check.state.value:{state}}  {check.found}" + f"; {check.remedy}" * bool(check.remedy)
        for check in checks
    ]
