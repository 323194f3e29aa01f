"""Reading of an archive: opening it, the data of one profile, and the current to report."""
