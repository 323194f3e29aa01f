"""Figure of study ``nulls``."""
