"""The report: a mission, or one profile of it, as one self-contained HTML page with its tables and figures beside."""

from gliderhpc.report.page.rendering import Written
from gliderhpc.report.page.report import write_mission_page, write_profile_page

__all__ = ["Written", "write_mission_page", "write_profile_page"]
