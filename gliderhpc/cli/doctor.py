"""``gliderhpc doctor``: whether this machine has what a run needs."""

from collections.abc import Sequence
from pathlib import Path

import click

from gliderhpc.cli import options
from gliderhpc.cli.main import DONE, FAILED
from gliderhpc.cli.text import say
from gliderhpc.mission.doctor import Check, State, examine
from gliderhpc.store_schema.place import Place


@click.command("doctor")
@click.option(
    "--store", type=options.PLACE, default=Path(), show_default="this folder",
    help="Where archives are to lie: a folder, or s3://BUCKET/FOLDER.",
)  # fmt: skip
@options.scheduler_option
@options.scheduler_file_option
def command(store: Place, scheduler: str | None, scheduler_file: Path | None) -> int:
    """Look at what a run needs: versions, processor, compiled kernels, room to write, a cluster, optional extras.

    Exit status 1: something that a run needs is missing; its line says what to do. What is absent is optional.

    \b
    Examples:
      gliderhpc doctor
      gliderhpc doctor --store /scratch/missions --scheduler-file scheduler.json
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    checks = list(examine(store, options.cluster_address(scheduler, scheduler_file)))
    for line in lines_of(checks):
        say(line)
    lacking = [check.name for check in checks if check.state is State.MISSING]
    say(f"missing: {', '.join(lacking)}" if lacking else "all that a run needs is there")
    return FAILED if lacking else DONE


def lines_of(checks: Sequence[Check]) -> list[str]:
    """Aligned lines: name, state, what is there, and what to do."""
    name = max(len(check.name) for check in checks)
    state = max(len(check.state.value) for check in checks)
    return [
        f"{check.name:{name}}  {check.state.value:{state}}  {check.found}" + f"; {check.remedy}" * bool(check.remedy)
        for check in checks
    ]
