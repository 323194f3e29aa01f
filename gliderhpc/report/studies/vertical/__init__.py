"""Figure and table of study ``vertical``."""
