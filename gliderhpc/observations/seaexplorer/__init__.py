"""ALSEAMAR SeaExplorer text files (``*.gli.sub.*`` and ``*.pld1.sub.*``) into the observation format."""

from gliderhpc.observations.seaexplorer.importer import ImportSummary, import_seaexplorer

__all__ = ["ImportSummary", "import_seaexplorer"]
