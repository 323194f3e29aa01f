"""OceanGliders OG1 netCDF files into the observation format."""

from gliderhpc.observations.og1.importer import import_og1

__all__ = ["import_og1"]
