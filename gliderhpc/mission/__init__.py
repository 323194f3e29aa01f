"""The main job: plan a mission, spread its profiles over workers, and leave an archive.

Follow a record: `planning` reads what there is and what it will need, `batch_job` takes profiles from their records
to their chunks (`profile_rows`), `executors` spreads such jobs, `run` holds it together, `summary` tells.
"""
