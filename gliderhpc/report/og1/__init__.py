"""Export of an archive's results as an OceanGliders OG1 netCDF file."""

from gliderhpc.report.og1.export import ExportSummary, export_og1

__all__ = ["ExportSummary", "export_og1"]
