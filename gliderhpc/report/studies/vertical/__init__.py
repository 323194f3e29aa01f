"""Figure and table of study ``vertical``."""

from gliderhpc.report.studies.vertical.show import show

__all__ = ["show"]
