"""Outputs of several verbs: findings of a study, and platform files, checked before the work."""

from collections.abc import Iterable
from pathlib import Path

import click

from gliderhpc.cli.console import results
from gliderhpc.cli.messages import say
from gliderhpc.findings.comparison import comparison_table
from gliderhpc.findings.findings import Findings, write_findings
from gliderhpc.output_files import check_output

_MAX_SHOWN_FAILURES = 10


def conclude(findings: Findings, study: str, folder: Path) -> int:
    """Write and print a study's findings, and return the exit status."""
    written = write_findings(findings, study, folder)
    console = results()
    for title, rows in findings.comparisons.items():
        console.print(comparison_table(rows, title))
    for remark in findings.remarks:
        say(f"note: {remark}")
    for number, why in list(findings.failed.items())[:_MAX_SHOWN_FAILURES]:
        say(f"profile {number} left out: {why}")
    for path in written:
        say(f"written to {path}")
    return 1 if findings.failed else 0


out_option = click.option(
    "--out",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.yaml",
    help="The platform file to write.",
)


def check_place(out: Path, overwrite: bool, inputs: Iterable[Path | str] = ()) -> None:
    """Check before the work that its output can be written."""
    check_output(out, overwrite=overwrite, inputs=inputs, instead="another --out")
