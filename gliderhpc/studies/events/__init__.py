"""Study ``events``: the catalogue of impulsive events above what nulls reach (section 5.3)."""

from gliderhpc.studies.events.study import STUDY

__all__ = ["STUDY"]
