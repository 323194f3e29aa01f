"""SeaExplorer text files (``*.gli.sub.*``, ``*.pld1.raw.*``, ``*.pld1.sub.*``) into the observation format."""

from gliderhpc.observations.seaexplorer.importer import import_seaexplorer

__all__ = ["import_seaexplorer"]
