"""Report of a mission or of one profile: one self-contained HTML page, with its tables and figures as files."""

from gliderhpc.report.page.rendering import Written
from gliderhpc.report.page.report import write_mission_page, write_profile_page, write_report

__all__ = ["Written", "write_mission_page", "write_profile_page", "write_report"]
