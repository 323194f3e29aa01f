"""Long-term drift of the disturbances over a mission (section 5.6): is the hull fouling, since when, and how sure."""

from gliderhpc.studies.drift.study import STUDY

__all__ = ["STUDY"]
