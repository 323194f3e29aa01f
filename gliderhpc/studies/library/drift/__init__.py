"""Trends, change points and drag of the study `gliderhpc.studies.drift` (section 5.6).

`medians` computes the medians of a profile, `series` the trends of the twelve series, `coefficients` their slopes for
drawn hulls, and `drag` the equivalent change of drag. `window_search`, `change_shapes` and `change_points` find steps,
ramps and episodes. `change_text` describes and stores these, and `verdict` draws the conclusion.
"""
