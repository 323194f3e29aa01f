"""Trends, change points and drag of the study `gliderhpc.studies.drift` (section 5.6).

`medians` has a profile's; `series` the trends of the twelve series, `coefficients` their slopes under drawn hulls and
`drag` what they are equivalent to. `window_search`, `change_shapes` and `change_points` find steps, ramps and episodes;
`change_text` puts them into words and into the archive, `verdict` draws the conclusion.
"""
