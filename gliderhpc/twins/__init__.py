"""Twin experiments: simulated dives inverted by the users' own pipeline; estimates compared with a known truth.

`cases` describes the flight, the record and the assumptions of a twin, `inversion` simulates and inverts it, `scoring`
computes its row of scores, and `study` distributes runs over workers and makes findings from the rows. Each experiment
is a folder, with its runs and conclusions in `experiment` and its figure in `figure`: `windows`, `sensitivity`,
`recoverability`, `currents` and `estimators`.
"""
