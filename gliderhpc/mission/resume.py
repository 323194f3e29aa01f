"""Going on with an archive: what it takes to trust it, to make it larger, and to leave nothing untrue in it."""

import logging
from typing import Any

from gliderhpc.errors import InputError
from gliderhpc.mission.planning import MissionPlan
from gliderhpc.mission.standing import Standing, examine
from gliderhpc.mission.work import MissionWork
from gliderhpc.store_schema import (
    SCHEMA_VERSION,
    ArchiveRows,
    is_archive,
    read_attributes,
    read_profiles,
    set_attributes,
    structure_differences,
    write_coordinates,
    write_mission_table,
)
from gliderhpc.store_schema.create import mission_sizes
from gliderhpc.store_schema.deep_check import damaged_studies
from gliderhpc.store_schema.grow import check_continuation, grow_archive, mark_studies_outdated
from gliderhpc.store_schema.mend import mend_metadata
from gliderhpc.store_schema.place import remove_partial_files

log = logging.getLogger(__name__)


def examine_archive(work: MissionWork, plan: MissionPlan, append: bool) -> tuple[list[int], Standing]:
    """Find out which profiles of an archive stand; nothing is changed but damaged metadata, which is mended.

    Parameters
    ----------
    work : MissionWork
        Inputs, and the archive.
    plan : MissionPlan
        Profiles and sizes of the run.
    append : bool
        Whether the archive may grow.

    Returns
    -------
    numbers : list of int
        Numbers of the profiles that the archive is to hold.
    standing : Standing
        Which stand, and which are to be done.

    Raises
    ------
    InputError
        There is no archive, or one that this run cannot go on with.
    """
    store = work.store
    for name in mend_metadata(store):
        log.warning("%s: %s: the metadata is damaged; it is written again from the schema", store, name)
    _check_version(store)
    numbers = read_profiles(store)
    if append:
        check_continuation(store, numbers, plan.profiles)
        numbers = list(plan.profiles)
    else:
        _check_structure(store)
        _check_fits(store, numbers, plan)
    chosen = set(plan.profiles)
    inputs = {i: work.inputs(n) for i, n in enumerate(numbers) if n in chosen}
    standing = examine(store, numbers, inputs)
    log.info("%s: %s", store, standing.describe())
    for line in (*standing.damages, *damaged_studies(store)):
        log.warning("%s: %s", store, line)
    return numbers, standing


def make_ready(
    work: MissionWork, attributes: dict[str, Any], plan: MissionPlan, standing: Standing, append: bool
) -> None:
    """Bring an archive to where work can go on: room for new profiles, no marker of those to be done, a true table.

    Parameters
    ----------
    work, plan, append
        As for :func:`examine_archive`.
    attributes : dict
        Root attributes of the archive, which replace those that are there.
    standing : Standing
        What :func:`examine_archive` found.

    Raises
    ------
    InputError
        The archive grew into something that the schema does not allow.
    """
    store = work.store
    remove_partial_files(store)
    if append:
        grow_archive(store, plan.profiles, plan.sizes)
        _check_structure(store)
    rows = ArchiveRows(store)
    for index in standing.anew:
        rows.begin(index)
    if standing.anew:
        mark_studies_outdated(store, f"made before {len(standing.anew)} profiles were done anew or added")
    write_coordinates(store)
    write_mission_table(store, standing.kept)
    set_attributes(store, attributes)


def _check_version(store: str) -> None:
    if not is_archive(store):
        raise InputError(f"{store}: is no archive of gliderhpc, so there is nothing to resume; give another --store")
    version = read_attributes(store).get("schema_version")
    if version != SCHEMA_VERSION:
        raise InputError(
            f"{store}: was made with another schema version, {version}; finish it with the gliderhpc that began it, or "
            "start anew with --overwrite"
        )


def _check_structure(store: str) -> None:
    differences = structure_differences(store, studies=False)
    if differences:
        raise InputError(f"{store}: {differences[0]}; its chunks cannot be trusted, start anew with --overwrite")


def _check_fits(store: str, numbers: list[int], plan: MissionPlan) -> None:
    if not set(plan.profiles) <= set(numbers) or len(numbers) > len(plan.profiles):
        raise InputError(
            f"{store}: was made for other profiles; resume with the same --profiles, add new ones with --append, or "
            "use --overwrite"
        )
    sizes = mission_sizes(store)
    short = [dim for dim, size in plan.sizes.items() if size > sizes[dim]]
    if short:
        raise InputError(
            f"{store}: its rows are too short for these inputs ({', '.join(short)}); use --append, which lengthens "
            "them, or --overwrite"
        )
