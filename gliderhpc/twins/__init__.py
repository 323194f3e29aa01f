"""Twin experiments: simulated dives inverted by the users' own pipeline; estimates compared with a known truth.

`cases` describes what is flown, recorded and assumed, `inversion` simulates and inverts it, `scoring` makes a row of
numbers of it, and `study` spreads runs over workers and makes findings of the rows. The experiments are `windows`,
`sensitivity`, `recoverability`, `currents` and `estimators`.
"""
