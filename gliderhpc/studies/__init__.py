"""Studies of a finished mission, one module or package each."""
