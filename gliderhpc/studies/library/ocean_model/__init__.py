"""Ocean models: their files, and their currents at a glider's place and time."""
