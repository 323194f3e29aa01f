"""Run of a mission: plan it, distribute its profiles over workers, and write the archive.

`planning` checks the inputs and sizes the run, `jobs` processes profiles from their records to their chunks
(`profile_rows`), `executors` distributes the jobs, `resume` decides what an existing archive still needs, and `run`
combines them and reports.
"""
