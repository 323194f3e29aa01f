"""Parts that the imports of all instruments share: the workflow, rows, clocks and dives."""
