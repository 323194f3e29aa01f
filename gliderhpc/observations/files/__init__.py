"""Files of any program: opening, recognising, reading of columns with their units and flags, and descriptions."""
