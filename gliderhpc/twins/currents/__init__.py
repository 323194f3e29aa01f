"""``twin currents``: whether the current's ellipses hold, and what of a sheared current the yaw moment shows."""
