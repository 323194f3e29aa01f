"""Message of one dive at its surfacing, collected from the archive: current, next surfacing, anomalies, hull and trim.

`dive_results` collects a `message`. `next_surfacing` predicts where and when the next dive ends, from the `nowcast` of
the current, the displacement expected through the water (`next_displacement`) and the pilot's `dive_plan`.
`recent_hull` combines the information of the latest dives on the hull.
"""
