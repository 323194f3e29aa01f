"""Figure, table and captions of study ``reanalysis``."""
