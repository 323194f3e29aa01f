"""Statistics of a disturbance's fast part, on plain arrays: what the studies of turbulence are made from (section 5.3).

Spectra, increments, surrogates and the rank test know nothing of archives; `gliderhpc.studies.spectra`,
`intermittency`, `nulls` and `events` are the studies.
"""
