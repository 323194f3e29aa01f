"""Estimation of a hull from a mission's records, in the order of its steps, with the workers of a mission.

`workflow` chooses the profiles and takes them through the fit to steady glides (`glides`), the rounds over whole dives
(`dives`) if these are requested, and the tuning of the disturbance prior (`prior`). The result is one of the
`estimated_hulls`; the module `text` of each folder writes its tables, notes and provenance in the platform file.
"""
