"""Figure, tables and captions of study ``drift``."""

from gliderhpc.report.studies.drift.show import show

__all__ = ["show"]
