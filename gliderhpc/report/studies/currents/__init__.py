"""Figure, table and captions of study ``currents``."""

from gliderhpc.report.studies.currents.show import show

__all__ = ["show"]
