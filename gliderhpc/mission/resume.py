"""Resumption of a run: determine the valid profiles, extend the archive, and clear the profiles to be recomputed."""

import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gliderhpc.errors import InputError
from gliderhpc.mission.input_digests import FIXES, differs_in_fixes_only
from gliderhpc.mission.jobs import RunInputs
from gliderhpc.mission.planning import MissionPlan
from gliderhpc.mission.profile_rows import Row
from gliderhpc.store_schema import (
    SCHEMA_VERSION,
    ArchiveRows,
    is_archive,
    read_attributes,
    read_commits,
    read_profiles,
    set_attributes,
    structure_differences,
    write_coordinates,
    write_mission_table,
)
from gliderhpc.store_schema.commits import Commit, Marker, damages, read_markers
from gliderhpc.store_schema.create import mission_sizes
from gliderhpc.store_schema.deep_check import Fault, as_lines, damaged_studies
from gliderhpc.store_schema.location import Location, kind_of_other, remove_partial_files
from gliderhpc.store_schema.maintenance import check_continuation, grow_archive, mark_studies_outdated, mend_metadata
from gliderhpc.wording import counted

log = logging.getLogger(__name__)

DIFFERENCES = {
    "software": "another version of gliderhpc",
    "settings": "other settings",
    "platform": "another platform",
    "record": "another record",
    FIXES: "other fixes",
}
"""Description of a difference by kind of input, in the order in which differences are reported."""

MISSING, FAILED, DAMAGED = "missing", "failed before", "damaged"


@dataclass(frozen=True)
class Validity:
    """Validity of an archive's profiles for a run.

    Attributes
    ----------
    valid : mapping of int to Row
        Table row of every profile that is still valid, by position.
    outstanding : mapping of int to str
        Reason why a profile must be computed, by position.
    damages : tuple of str
        Damaged chunks, one line each.
    amendable : mapping of int to Commit
        Commits, by position, of outstanding profiles that differ only in their fixes.
    """

    valid: Mapping[int, Row]
    outstanding: Mapping[int, str]
    damages: tuple[str, ...] = ()
    amendable: Mapping[int, Commit] = field(default_factory=dict)

    def describe(self) -> str:
        """Describe for the log the numbers of valid profiles and of those to be computed, by reason."""
        counts = Counter(self.outstanding.values())
        reasons = ", ".join(f"{count} {reason}" for reason, count in counts.most_common())
        outstanding = f"to be computed: {reasons}" if reasons else "nothing to compute"
        return f"{counted(len(self.valid), 'profile is', 'profiles are')} valid; {outstanding}"


def check_profiles(
    location: Location, numbers: Sequence[int], inputs: Mapping[int, Mapping[str, str]], check_last: int | None = None
) -> Validity:
    """Determine the valid profiles: those that are done, have these inputs, and have undamaged chunks.

    Parameters
    ----------
    location : str or Path
        The archive.
    numbers : sequence of int
        Numbers of its profiles.
    inputs : mapping of int to mapping of str to str
        Digests of each profile's inputs, by position; profiles without an entry are not valid.
    check_last : int, optional
        Number of profiles at the end whose chunks and manifests are checked; by default all, which takes longer.
    """
    first_checked = 0 if check_last is None else len(numbers) - check_last
    unchecked = {
        index: marker.row
        for index, marker in (read_markers(location) if first_checked > 0 else {}).items()
        if index < first_checked and _describe_reason(marker, inputs.get(index)) is None
    }
    positions = [index for index in range(len(numbers)) if index not in unchecked]
    commits = read_commits(location, positions)
    reasons = {index: _describe_reason(commits.get(index), inputs.get(index)) for index in positions}
    outstanding = {index: reason for index, reason in reasons.items() if reason is not None}
    candidates = {
        index: commit
        for index, reason in reasons.items()
        if reason is None and isinstance(commit := commits[index], Commit)
    }
    damaged = damages(location, candidates)
    outstanding |= {damage.profile_index: DAMAGED for damage in damaged}
    valid = {index: dict(row) for index, row in unchecked.items()}
    valid |= {index: dict(commit.row) for index, commit in candidates.items() if index not in outstanding}
    faults = [
        Fault(f"profile {numbers[damage.profile_index]}", damage.variable, damage.what, "it will be recomputed")
        for damage in damaged
    ]
    amendable = {
        index: committed
        for index in outstanding
        if isinstance(committed := commits.get(index), Commit)
        and index in inputs
        and differs_in_fixes_only(committed, inputs[index])
    }
    return Validity(valid, dict(sorted(outstanding.items())), tuple(as_lines(faults)), amendable)


def _describe_reason(commit: Commit | Marker | str | None, inputs: Mapping[str, str] | None) -> str | None:
    """Describe why a profile is not valid, or return None if it is; damaged chunks are not considered."""
    if commit is None or inputs is None:
        return MISSING
    if isinstance(commit, str):
        return DAMAGED
    difference = next((text for kind, text in DIFFERENCES.items() if commit.inputs.get(kind) != inputs[kind]), None)
    if difference is not None:
        return f"made with {difference}"
    return None if commit.row.get("status") == "done" else FAILED


def examine_archive(
    run: RunInputs, plan: MissionPlan, append: bool, check_last: int | None = None
) -> tuple[list[int], Validity]:
    """Determine the valid profiles of an archive; nothing is changed except damaged metadata, which is repaired.

    Parameters
    ----------
    run : RunInputs
        Inputs and archive of the run.
    plan : MissionPlan
        Profiles and sizes of the run.
    append : bool
        Whether the archive may grow.
    check_last : int, optional
        Number of profiles at the end whose chunks are checked (`check_profiles`).

    Returns
    -------
    numbers : list of int
        Numbers of the profiles in the archive, including new ones.
    validity : Validity
        Valid profiles, and those that must be computed.

    Raises
    ------
    InputError
        There is no archive, or this run cannot continue it.
    """
    store = run.store
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
    inputs = {index: run.inputs(number) for index, number in enumerate(numbers)}
    validity = check_profiles(store, numbers, inputs, check_last)
    log.info("%s: %s", store, validity.describe())
    for line in (*validity.damages, *damaged_studies(store)):
        log.warning("%s: %s", store, line)
    return numbers, validity


def prepare_archive(
    run: RunInputs, attributes: dict[str, Any], plan: MissionPlan, validity: Validity, append: bool
) -> None:
    """Prepare an archive for the run: extend it for new profiles, clear the markers of outstanding ones, update tables.

    Parameters
    ----------
    run, plan, append
        Arguments of :func:`examine_archive`.
    attributes : dict
        Root attributes of the archive, which replace the existing ones.
    validity : Validity
        Result of :func:`examine_archive`.

    Raises
    ------
    InputError
        The grown archive does not conform to the schema.
    """
    store = run.store
    remove_partial_files(store)
    if append:
        grow_archive(store, plan.profiles, plan.sizes)
        _check_structure(store)
    rows = ArchiveRows(store)
    for index in validity.outstanding:
        rows.begin(index)
    if validity.outstanding:
        recomputed = counted(len(validity.outstanding), "profile was", "profiles were")
        mark_studies_outdated(store, f"made before {recomputed} recomputed or added")
    write_coordinates(store)
    write_mission_table(store, validity.valid)
    set_attributes(store, attributes)


def _check_version(store: str) -> None:
    if not is_archive(store):
        raise InputError(f"{store}: is {kind_of_other(store)}, so there is nothing to resume; give another `store`")
    version = read_attributes(store).get("schema_version")
    if version != SCHEMA_VERSION:
        raise InputError(
            f"{store}: was made with another schema version, {version}; finish it with the version of gliderhpc that "
            "began it, or start again with `overwrite=True`"
        )


def _check_structure(store: str) -> None:
    differences = structure_differences(store, studies=False)
    if differences:
        raise InputError(f"{store}: {differences[0]}; its content cannot be used; start again with `overwrite=True`")


def _check_fits(store: str, numbers: list[int], plan: MissionPlan) -> None:
    if set(plan.profiles) != set(numbers):
        raise InputError(
            f"{store}: was made for other profiles; resume with the same `profiles`, add new ones with "
            "`append=True`, or use `overwrite=True`"
        )
    sizes = mission_sizes(store)
    too_short = [dim for dim, size in plan.sizes.items() if size > sizes[dim]]
    if too_short:
        raise InputError(
            f"{store}: its rows are too short for these inputs ({', '.join(too_short)}); use `append=True`, which "
            "lengthens them, or `overwrite=True`"
        )
