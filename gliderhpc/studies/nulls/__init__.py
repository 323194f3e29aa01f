"""Study ``nulls``: missions without turbulence through the same pipeline (section 5.3)."""

from gliderhpc.studies.nulls.study import STUDY

__all__ = ["STUDY"]
