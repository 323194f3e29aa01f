"""Study ``vertical``: the vertical velocity of the water."""

from gliderhpc.studies.vertical.study import STUDY

__all__ = ["STUDY"]
