"""Study ``nulls``: what the pipeline makes of missions without turbulence (section 5.3)."""

from gliderhpc.studies.nulls.study import STUDY

__all__ = ["STUDY"]
