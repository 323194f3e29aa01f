"""Teledyne Slocum records (``*.dbd`` and ``*.ebd``, or netCDF of native sensors) into the observation format."""

from gliderhpc.observations.slocum.importer import import_slocum

__all__ = ["import_slocum"]
