"""Estimation of a hull from a mission's records, in the order of its steps, with the workers of a mission.

`workflow` chooses the profiles and takes them through the fits of `gliderhpc.tuning`, and through rounds over whole
dives (`profile_calibration`, `hull_rounds`) if these are requested. The result is one of the `estimated_hulls`, whose
tables, notes and origin in the platform file are written by `glides_text`, `dives_text` and `prior_text`.
"""
