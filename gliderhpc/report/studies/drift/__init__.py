"""Figure, tables and captions of study ``drift``."""
