"""Treatment of an archive that exists already when a run begins."""

from enum import Enum
from typing import Self

from gliderhpc.errors import InputError


class Existing(Enum):
    """Treatment of an existing archive; without one, a new archive is always created."""

    REFUSE = "refuse"
    """Refuse to run."""
    OVERWRITE = "overwrite"
    """Replace the archive."""
    RESUME = "resume"
    """Finish the archive, and recompute damaged profiles and those of other inputs."""
    APPEND = "append"
    """Finish the archive, and add profiles that are new in the observations."""

    @classmethod
    def of(cls, *, overwrite: bool, resume: bool, append: bool) -> Self:
        """Return the treatment that the user's options choose.

        Raises
        ------
        InputError
            More than one is set.
        """
        chosen = [name for name, given in (("overwrite", overwrite), ("resume", resume), ("append", append)) if given]
        if len(chosen) > 1:
            raise InputError(
                "`overwrite=True`, `resume=True` and `append=True` are mutually exclusive; give one of them"
            )
        return cls(chosen[0] if chosen else "refuse")

    @property
    def continues(self) -> bool:
        """Return whether results of the archive are retained."""
        return self in (Existing.RESUME, Existing.APPEND)
