"""A mission's run: plan it, distribute its profiles over workers, and write the archive.

`planning` sizes the run, `jobs` processes profiles from their records to their chunks (`profile_rows`), `executors`
distributes the jobs, `validity` and `resume` decide what an existing archive still needs, `run` combines them, and
`summary` reports.
"""
