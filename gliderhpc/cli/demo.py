"""``gliderhpc demo``: the tour on an embedded synthetic mission."""

from pathlib import Path

import click

@click.command("demo")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=Path("demo"), show_default=True)
def command(out: Path) -> int:
    """d"""
    return 0
