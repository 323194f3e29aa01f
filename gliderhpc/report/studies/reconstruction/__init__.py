"""Figures, tables and captions of study ``reconstruction``."""

from gliderhpc.report.studies.reconstruction.show import show

__all__ = ["show"]
