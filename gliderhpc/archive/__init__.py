"""Reading an archive: opening it, one profile's data, and the current to report."""
