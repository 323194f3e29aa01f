"""Statistics of a disturbance's fast part, on plain arrays, for the studies of turbulence (section 5.3).

`series` reads a channel from an archive or an estimate, high-passes it and excludes unusable samples. `statistics` has
spectra and structure functions, `surrogates` the rank test among surrogates, and `gaussianity` the test on the
smoother's standardised noise. `ensembles` reads measured profiles and nulls, and `verdict` compares them. The studies
are `gliderhpc.studies.spectra`, `intermittency`, `nulls` and `events`.
"""
