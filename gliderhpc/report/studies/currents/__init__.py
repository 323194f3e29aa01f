"""Figure, table and captions of study ``currents``."""
