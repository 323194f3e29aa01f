"""What of an archive stands when a run goes on with it, and what has to be done anew, and why."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gliderhpc.mission.inputs import first_difference
from gliderhpc.mission.profile_rows import Row
from gliderhpc.store_schema import read_commits
from gliderhpc.store_schema.commits import Commit, damages
from gliderhpc.store_schema.faults import Fault, as_lines
from gliderhpc.store_schema.place import Place

MISSING, FAILED, DAMAGED = "missing", "failed before", "damaged"


@dataclass(frozen=True)
class Standing:
    """What a run finds.

    Attributes
    ----------
    kept : mapping of int to Row
        By position, the row of every profile that stands.
    anew : mapping of int to str
        By position, why a profile is to be done.
    damages : tuple of str
        Chunks that are not what was written, in lines for people.
    """

    kept: Mapping[int, Row]
    anew: Mapping[int, str]
    damages: tuple[str, ...] = ()

    def describe(self) -> str:
        """Sentence for the log: how many stand, and how many are done for which reason."""
        counts = Counter(self.anew.values())
        todo = ", ".join(f"{count} {reason}" for reason, count in counts.most_common())
        return f"{len(self.kept)} profiles stand; " + (f"to be done: {todo}" if todo else "nothing is to be done")


def examine(place: Place, numbers: Sequence[int], inputs: Mapping[int, Mapping[str, str]]) -> Standing:
    """Find out what stands: profiles that are done, from these inputs, with every chunk as it was written.

    Parameters
    ----------
    place : str or Path
        The archive.
    numbers : sequence of int
        Its profiles' numbers.
    inputs : mapping of int to mapping of str to str
        By position, what each profile is to be made from; those left out do not stand.
    """
    commits = read_commits(place)
    reasons = {index: _reason(commits.get(index), inputs.get(index)) for index in range(len(numbers))}
    sound = {index: commits[index] for index, reason in reasons.items() if reason is None}
    found = damages(place, {index: commit for index, commit in sound.items() if isinstance(commit, Commit)})
    anew = {index: reason for index, reason in reasons.items() if reason is not None}
    anew |= {damage.profile_index: DAMAGED for damage in found}
    kept = {
        index: dict(commit.row) for index, commit in sound.items() if index not in anew and isinstance(commit, Commit)
    }
    faults = [
        Fault(f"profile {numbers[one.profile_index]}", one.variable, one.what, "it is done anew") for one in found
    ]
    return Standing(kept, dict(sorted(anew.items())), tuple(as_lines(faults)))


def _reason(commit: Commit | str | None, inputs: Mapping[str, str] | None) -> str | None:
    """Say why a profile does not stand."""
    if commit is None or inputs is None:
        return MISSING
    if isinstance(commit, str):
        return DAMAGED
    difference = first_difference(dict(commit.inputs), dict(inputs))
    if difference is not None:
        return f"made with {difference}"
    return None if commit.row.get("status") == "done" else FAILED
