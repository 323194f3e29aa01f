"""From one profile's record to its disturbances, motion and currents.

Follow a profile through `profile.estimate_profile`, which filters, smooths and inverts it. Before it, `preparation`
brings the record onto the steps; after it come `quality`, and `self_motion` and `currents` for the depth-averaged
current.
"""
