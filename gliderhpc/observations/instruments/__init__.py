"""Readers of the instruments' own files: SeaExplorer, Slocum, Seaglider and OceanGliders OG1."""
