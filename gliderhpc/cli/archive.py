"""``gliderhpc info``, ``check`` and ``compare``: content of an archive, its faults, and differences of two archives."""

from collections.abc import Mapping
from typing import Any

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gliderhpc.archive.mission import Summary, archive_errors, attribute_faults, describe
from gliderhpc.cli import options
from gliderhpc.cli.console import results
from gliderhpc.cli.messages import Verb, echo
from gliderhpc.errors import InputError
from gliderhpc.report.facts import facts, flatten_settings
from gliderhpc.store_schema import (
    check_archive,
    committed_chunk_faults,
    damaged_chunks,
    missing_chunks,
    other_version,
    read_attributes,
    read_commits,
    read_profiles,
    structure_differences,
    version_note,
)
from gliderhpc.store_schema.compare import compare_archives
from gliderhpc.store_schema.location import Location
from gliderhpc.wording import counted

SHOWN_MESSAGES = 20


@click.command("info", cls=Verb)
@click.argument("archive", type=options.PLACE)
@click.option("--all-messages", is_flag=True, help=f"Show every profile's message, not the first {SHOWN_MESSAGES}.")
def info(archive: Location, all_messages: bool) -> int:
    """Summarise ARCHIVE: mission, platform, settings, profiles by status, groups, messages, median current.

    Exit status 1: chunks are missing; a line at the end names each of them and the command that repairs it.

    \b
    Example:
      gliderhpc info mission.zarr
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    print_summary(describe(archive), results(), None if all_messages else SHOWN_MESSAGES)
    with archive_errors(archive):
        # An archive of another version has other variables, so chunks of this version would seem to be missing.
        other = other_version(archive)
        missing = [] if other else missing_chunks(archive)
        note = version_note(archive) or other
    if note:
        echo(f"note: {note}", err=True)
    for line in missing:
        echo(f"{archive}: {line}", err=True)
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
    for key, value in flatten_settings(settings):
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


@click.command("check", cls=Verb)
@click.argument("archive", type=options.PLACE)
@click.option("--deep", is_flag=True, help="Also compare every chunk with the digest recorded when it was written.")
def check(archive: Location, deep: bool) -> int:
    """Check that ARCHIVE is complete and undamaged.

    Groups, dimensions, variables, types, units, chunks and coordinates are compared with the schema, and the tables
    with what was recorded when each profile was completed; missing chunks are reported. With --deep every chunk is
    read; one that was truncated, deleted or changed is reported by profile and variable, with the command that repairs
    it. In an archive with another minor version of the schema, only the chunks of the profiles are checked. Exit status
    1: something differs; each difference is reported in one line.

    \b
    Examples:
      gliderhpc check mission.zarr
      gliderhpc check mission.zarr --deep
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    with archive_errors(archive):
        note = version_note(archive)
        differences = committed_chunk_faults(archive, deep=deep) if note else _differences(archive, deep)
    for line in differences:
        echo(line)
    if differences:
        echo(f"{archive}: {counted(len(differences), 'difference')}")
        return 1
    with archive_errors(archive):
        committed, profiles = len(read_commits(archive)), len(read_profiles(archive))
    count = f"{committed} of {counted(profiles, 'profile')}"
    if note:
        chunks = "no chunk of its profiles is missing or changed" if deep else "no chunk of its profiles is missing"
        echo(f"{archive}: {note}; {chunks}, and it is not compared with the schema of that version; {count} committed")
        return 0
    scope = "schema and digests" if deep else "schema, no chunk is missing"
    echo(f"{archive}: conforms to its {scope}; {count} committed")
    return 0


def _differences(archive: Location, deep: bool) -> list[str]:
    """List the differences from the schema, else faults of attributes, else missing or, if `deep`, damaged chunks."""
    differences = check_archive(archive) or list(attribute_faults(read_attributes(archive)))
    return differences or (damaged_chunks(archive) if deep else missing_chunks(archive))


SHOWN_PROFILES = 12


@click.command("compare", cls=Verb)
@click.argument("first", type=options.PLACE)
@click.argument("second", type=options.PLACE)
def compare(first: Location, second: Location) -> int:
    """List the differences between two runs: settings, platform, profiles, and where and how much variables differ.

    Exit status 0: nothing differs except computing times; 1: something does.

    \b
    Example:
      gliderhpc compare before.zarr after.zarr
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    with archive_errors(first, second):
        for archive in (first, second):
            for difference in structure_differences(archive, studies=False):
                raise InputError(f"{archive}: {difference}; only archives that conform to the schema can be compared")
        comparison = compare_archives(first, second)
    for line in comparison.attributes:
        echo(line)
    for archive, numbers in ((first, comparison.only_first), (second, comparison.only_second)):
        if numbers:
            shown = ", ".join(map(str, numbers[:SHOWN_PROFILES])) + (" ..." if len(numbers) > SHOWN_PROFILES else "")
            echo(f"only in {archive}: {counted(len(numbers), 'profile')} ({shown})")
    for variable in comparison.variables:
        echo(variable.describe())
    echo(
        f"{counted(comparison.same, 'profile is', 'profiles are')} the same"
        + (" in every value" if comparison.equal else "")
    )
    return 0 if comparison.equal else 1
