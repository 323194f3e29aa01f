"""Study ``intermittency``: increments of a disturbance's fast part beside surrogates (section 5.3)."""

from gliderhpc.studies.intermittency.study import STUDY

__all__ = ["STUDY"]
