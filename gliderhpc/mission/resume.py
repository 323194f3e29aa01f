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
from gliderhpc.store_schema.grow import grow_archive, mark_studies_outdated
from gliderhpc.store_schema.place import remove_partial_files

log = logging.getLogger(__name__)


def go_on(work: MissionWork, attributes: dict[str, Any], plan: MissionPlan, append: bool) -> Standing:
    """Bring an archive to where work can go on, and say what stands and what is to be done.

    Parameters
    ----------
    work : MissionWork
        What is to be done.
    attributes : dict
        Root attributes of the archive, which replace those that are there.
    plan : MissionPlan
        Profiles and sizes.
    append : bool
        Whether the archive may grow.

    Raises
    ------
    InputError
        There is no archive, or one that cannot be gone on with.
    """
    store = work.store
    _check_version(store)
    remove_partial_files(store)
    if append:
        grow_archive(store, plan.profiles, plan.sizes)
    _check_structure(store)
    _check_fits(store, plan)
    numbers = read_profiles(store)
    standing = examine(store, numbers, {i: work.inputs(n) for i, n in enumerate(numbers) if n in plan.profiles})
    log.info("%s: %s", store, standing.describe())
    for line in standing.damages:
        log.warning("%s: %s; it is done anew", store, line)
    rows = ArchiveRows(store)
    for index in standing.anew:
        rows.begin(index)
    if standing.anew:
        mark_studies_outdated(store, f"made before {len(standing.anew)} profiles were done anew or added")
    write_coordinates(store)
    write_mission_table(store, standing.kept)
    set_attributes(store, attributes)
    return standing


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


def _check_fits(store: str, plan: MissionPlan) -> None:
    numbers = read_profiles(store)
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
