"""Figure and tables of ``gliderhpc validate``."""

from gliderhpc.report.studies.validation.show import show

__all__ = ["show"]
