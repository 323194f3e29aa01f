"""Figure, table and captions of study ``reanalysis``."""

from gliderhpc.report.studies.reanalysis.show import show

__all__ = ["show"]
