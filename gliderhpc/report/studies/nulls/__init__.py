"""Figure of study ``nulls``."""

from gliderhpc.report.studies.nulls.show import show

__all__ = ["show"]
