"""Fitting a hull, its disturbance prior and its sensors to a mission's own records."""
