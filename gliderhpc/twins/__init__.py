"""Twin experiments: worlds we made, inverted by the very pipeline that users run, and held against their truth.

`inversion` says what is flown, recorded and assumed, and makes it so; `scoring` turns one inversion into a row of
numbers; `runs` spreads rows over workers; `windows`, `sensitivity`, `recoverability` and `estimators` are the studies.
"""
