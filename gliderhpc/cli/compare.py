"""``gliderhpc compare``: differences between two archives."""

import click

from gliderhpc.archive.mission import reading
from gliderhpc.cli import options
from gliderhpc.cli.messages import say
from gliderhpc.errors import InputError
from gliderhpc.store_schema import structure_differences
from gliderhpc.store_schema.compare import compare_archives
from gliderhpc.store_schema.place import Place

SHOWN_PROFILES = 12


@click.command("compare")
@click.argument("first", type=options.PLACE)
@click.argument("second", type=options.PLACE)
def command(first: Place, second: Place) -> int:
    """List the differences between two runs: settings, platform, profiles, and every variable by how much and where.

    Exit status 0: nothing differs except computing times; 1: something does.

    \b
    Example:
      gliderhpc compare before.zarr after.zarr
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    with reading(first, second):
        for place in (first, second):
            for difference in structure_differences(place, studies=False):
                raise InputError(f"{place}: {difference}; only archives that conform to the schema can be compared")
        found = compare_archives(first, second)
    for line in found.attributes:
        say(line)
    for place, numbers in ((first, found.only_first), (second, found.only_second)):
        if numbers:
            shown = ", ".join(map(str, numbers[:SHOWN_PROFILES])) + (" ..." if len(numbers) > SHOWN_PROFILES else "")
            say(f"only in {place}: {len(numbers)} profiles ({shown})")
    for variable in found.variables:
        say(variable.describe())
    say(f"{found.same} profiles are the same" + (" in every value" if found.equal else ""))
    return 0 if found.equal else 1
