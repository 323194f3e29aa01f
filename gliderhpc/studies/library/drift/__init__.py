"""Trends, change points and drag of the study `gliderhpc.studies.drift` (section 5.6).

`medians` computes the medians of a profile, `series` the trends of the twelve series, `coefficients` their slopes for
drawn hulls, and `drag` the equivalent change of drag. `departures` finds windows in which a series departs
from its line, `shape_fits` fits steps, ramps and episodes there, `change_search` finds them in the series of a mission,
and `change_points` turns those that are significant and large into `changes`. `change_text` describes these,
`change_rows` stores them, and `verdict` draws the conclusion.
"""
