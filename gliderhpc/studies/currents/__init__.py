"""Study ``currents``: depth-averaged and depth-resolved currents with their uncertainty (sections 5.4 and 5.5)."""

from gliderhpc.studies.currents.study import STUDY

__all__ = ["STUDY"]
