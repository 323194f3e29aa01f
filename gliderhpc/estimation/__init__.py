"""Estimation of the disturbances, motion and currents of one profile from its record.

The entry point is `profile.estimate_profile`, which filters, smooths and inverts a profile. Before it, `preparation`
interpolates the record to the steps. After it, `quality` sets flags, and `self_motion` and `currents` give the
depth-averaged current.
"""
