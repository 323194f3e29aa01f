"""Figure, tables and captions of study ``spectra``."""
