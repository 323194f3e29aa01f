"""Outcomes of a window's solution, each with a code and a sentence."""

from enum import IntEnum


class Outcome(IntEnum):
    """Outcome of one window, stored as a CF flag value."""

    CONVERGED = 0
    ITERATION_LIMIT = 1
    STALLED = 2
    DIVERGED = 3
    NO_DATA = 4

    @property
    def label(self) -> str:
        """Name in lower case with spaces, such as ``iteration limit``."""
        return self.name.lower().replace("_", " ")

    @property
    def sentence(self) -> str:
        """Sentence that describes the outcome."""
        return _SENTENCES[self]

    @property
    def usable(self) -> bool:
        """Return whether the window's own solution is used (otherwise the prior)."""
        return self not in (Outcome.DIVERGED, Outcome.NO_DATA)

    @property
    def unfinished(self) -> bool:
        """Return whether the window was solved but has not converged."""
        return self not in (Outcome.CONVERGED, Outcome.NO_DATA)


_SENTENCES = {
    Outcome.CONVERGED: "the preset's optimality measure was met",
    Outcome.ITERATION_LIMIT: "the iteration limit was reached before the optimality measure was met",
    Outcome.STALLED: "the line search found no further decrease before the optimality measure was met",
    Outcome.DIVERGED: "no flyable trajectory was found that tracks the record better than the prior, which is used",
    Outcome.NO_DATA: "the window has no measured sample, so the prior is used",
}
