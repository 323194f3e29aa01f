"""Figure and captions of study ``events``."""

from gliderhpc.report.studies.events.show import show

__all__ = ["show"]
