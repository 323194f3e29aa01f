"""``gliderhpc info``: summary of an archive."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gliderhpc.archive.mission import Summary, describe, reading
from gliderhpc.cli import options
from gliderhpc.cli.console import results
from gliderhpc.cli.messages import say
from gliderhpc.report.facts import facts, flattened
from gliderhpc.store_schema import missing_chunks
from gliderhpc.store_schema.place import Place

SHOWN_MESSAGES = 20


@click.command("info")
@click.argument("archive", type=options.PLACE)
@click.option("--all-messages", is_flag=True, help=f"Show every profile's message, not the first {SHOWN_MESSAGES}.")
def command(archive: Place, all_messages: bool) -> int:
    """Summarise ARCHIVE: mission, platform, settings, profiles by status, groups, messages, median current.

    Exit status 1: chunks are missing; each line at the end names one, and the command that repairs it.

    \b
    Example:
      gliderhpc info mission.zarr
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    print_summary(describe(archive), results(), None if all_messages else SHOWN_MESSAGES)
    with reading(archive):
        missing = missing_chunks(archive)
    for line in missing:
        say(f"{archive}: {line}", err=True)
    return 1 if missing else 0


def print_summary(summary: Summary, console: Console, shown_messages: int | None) -> None:
    """Print a summary as tables.

    Parameters
    ----------
    summary : Summary
        Summary of the archive, by :func:`gliderhpc.archive.mission.describe`.
    console : rich.console.Console
        Output.
    shown_messages : int or None
        Number of messages to print, None for all.
    """
    console.print(_facts(summary))
    console.print(_groups(summary))
    settings = summary.attributes.get("settings")
    if isinstance(settings, Mapping) and settings:
        console.print(_settings(settings))
    if summary.messages:
        console.print(_messages(summary, shown_messages))


def _facts(summary: Summary) -> Table:
    table = Table(title=Text(str(summary.path)), show_header=False, title_justify="left")
    table.add_column("what", style="bold")
    table.add_column("value", overflow="fold")
    for what, value in facts(summary).items():
        table.add_row(what, Text(value))
    return table


def _groups(summary: Summary) -> Table:
    table = Table(title="groups", title_justify="left")
    for column in ("group", "variables", "dimensions"):
        table.add_column(column, justify="right" if column == "variables" else "left")
    for name, sizes in summary.groups.items():
        dimensions = ", ".join(f"{dim} {size}" for dim, size in sizes.items())
        note = f" ({summary.notes[name]})" if name in summary.notes else ""
        table.add_row(Text(name + note), str(summary.variables[name]), dimensions)
    return table


def _settings(settings: Mapping[str, Any]) -> Table:
    table = Table(title="settings", title_justify="left")
    table.add_column("setting")
    table.add_column("value", overflow="fold")
    for key, value in flattened(settings):
        table.add_row(Text(key), Text(str(value)))
    return table


def _messages(summary: Summary, shown: int | None) -> Table:
    rows = list(summary.messages.items())[:shown]
    left = len(summary.messages) - len(rows)
    caption = f"and {left} more; --all-messages shows them" if left else None
    table = Table(title="messages", title_justify="left", caption=caption, caption_justify="left")
    table.add_column("profile", justify="right")
    table.add_column("status")
    table.add_column("message", overflow="fold")
    for number, (status, message) in rows:
        table.add_row(str(number), status, Text(message))
    return table
