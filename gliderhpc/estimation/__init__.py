"""From one profile's series to its disturbances: prior, windows and what follows from them.

Follow a profile through `profile.estimate_profile`: vibration set, filter (the prior), windows, diagnosis; then
`currents` and `glide_angle` for the depth-averaged current.
"""
