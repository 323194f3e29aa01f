"""Reports of a mission, a profile, a surfacing or a fleet: self-contained HTML pages, with tables and figures as files.

`report` writes those of an archive. Nothing is imported here, so that the page of a surfacing needs no figures.
"""
