"""Figure, tables and captions of study ``spectra``."""

from gliderhpc.report.studies.spectra.show import show

__all__ = ["show"]
