"""``gliderhpc check``: comparison of an archive with its schema and digests."""

import click

from gliderhpc.archive.mission import attribute_faults, reading
from gliderhpc.cli import options
from gliderhpc.cli.messages import say
from gliderhpc.store_schema import (
    check_archive,
    damaged_chunks,
    missing_chunks,
    read_attributes,
    read_commits,
    read_profiles,
)
from gliderhpc.store_schema.place import Place


@click.command("check")
@click.argument("archive", type=options.PLACE)
@click.option("--deep", is_flag=True, help="Also compare every chunk with the digest with which it was written.")
def command(archive: Place, deep: bool) -> int:
    """Compare ARCHIVE with the schema: groups, dimensions, variables, types, units, chunks, coordinates.

    Missing chunks are found too, and the tables compared with the profiles' commits. Exit status 1: something differs;
    each difference is one line. With --deep every chunk is read, and one that was truncated, deleted or changed is
    reported by profile and variable, with the command that repairs it.

    \b
    Examples:
      gliderhpc check mission.zarr
      gliderhpc check mission.zarr --deep
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    with reading(archive):
        differences = check_archive(archive)
        if not differences:
            differences = list(attribute_faults(read_attributes(archive)))
        if not differences:
            differences = damaged_chunks(archive) if deep else missing_chunks(archive)
    for line in differences:
        say(line)
    if differences:
        say(f"{archive}: {len(differences)} {'difference' if len(differences) == 1 else 'differences'}")
        return 1
    with reading(archive):
        committed, profiles = len(read_commits(archive)), len(read_profiles(archive))
    scope = "schema and digests" if deep else "schema, no chunk is missing"
    say(f"{archive}: conforms to its {scope}; {committed} of {profiles} profiles committed")
    return 0
