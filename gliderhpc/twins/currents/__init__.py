"""``twin currents``: coverage of the current's ellipses, and the response of the retrieved current to shear."""
