"""Figure of study ``intermittency``."""

from gliderhpc.report.studies.intermittency.show import show

__all__ = ["show"]
