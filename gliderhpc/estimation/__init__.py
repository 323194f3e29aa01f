"""Estimation of the disturbances, motion and currents of one profile from its record.

The entry point is `profile.estimate_profiles`, which filters, smooths and inverts profiles. Before it,
`record_screening` and `filled_values` remove samples that are not measurements, and `preparation` interpolates the
record to the steps. After it, `quality` sets flags, and `self_motion` and `currents` give the
depth-averaged current.
"""
