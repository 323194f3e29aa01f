"""Study ``reconstruction``: how well the estimated disturbances reproduce the records (section 5.1)."""

from gliderhpc.studies.reconstruction.study import STUDY

__all__ = ["STUDY"]
