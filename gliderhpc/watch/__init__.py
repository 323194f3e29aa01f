"""Watch over a folder: every new dive is imported, inverted into the archive and reported as its files arrive.

`watcher` does so, with the imports of `records` and the archive of `inversion`; `versions` decides between versions of
a file that arrives again, `state` stores what was used and reported, and `alerts` checks each dive's message against
rules.
"""
