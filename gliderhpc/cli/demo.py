"""``gliderhpc demo``: all steps on an embedded synthetic mission."""

from pathlib import Path

import click

from gliderhpc.archive.mission import open_mission
from gliderhpc.cli.console import logging_to, results
from gliderhpc.cli.messages import say
from gliderhpc.cli.tour import run_demo
from gliderhpc.mission.summary import closing_line, summary_table
from gliderhpc.report.accuracy import accuracy_table, render


@click.command("demo")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("demo"),
    show_default=True,
    help="Folder for all output of the demo.",
)
def command(out: Path) -> int:
    """Simulate a mission, invert it, compare the result with the truth, run every study, and report on it.

    Studies with ensembles run at their quick sizes, which the page states.

    \b
    Example:
      gliderhpc demo --out demo
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    with logging_to(None):
        made = run_demo(out, lambda line: say(line, err=True), lambda _: None)
    console = results()
    console.print(summary_table(made.mission))
    console.print(render(accuracy_table(open_mission(made.store), made.truth)))
    say(closing_line(made.mission, str(made.store)))
    say(f"the archive: gliderhpc info {made.store}")
    say(f"the report: {made.report.page}")
    return 1 if made.mission.failed else 0
