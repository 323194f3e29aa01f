"""The main job: plan a mission, spread its profiles over workers, and leave an archive.

Follow a record: `planning` reads what there is and what it will need, `profile_job` takes one profile from its record
to its chunks, `executors` spreads such jobs, `run` holds it together, `summary` tells.
"""
