"""Checks of the records before inversion: findings and suggested corrections; nothing is corrected."""

from gliderhpc.record_checks.finding import CheckSettings, CheckVerdict, Finding
from gliderhpc.record_checks.inspection import Inspection, inspect_records

__all__ = ["CheckSettings", "CheckVerdict", "Finding", "Inspection", "inspect_records"]
