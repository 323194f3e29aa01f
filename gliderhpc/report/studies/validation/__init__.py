"""Figure and tables of ``gliderhpc validate``."""
