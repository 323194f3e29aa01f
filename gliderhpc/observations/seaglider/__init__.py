"""Seaglider per-dive netCDF files (``p*.nc``), as the basestation writes them, into the observation format."""

from gliderhpc.observations.seaglider.importer import import_seaglider

__all__ = ["import_seaglider"]
