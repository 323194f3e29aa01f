"""Where on the page the publication's figures and tables are, made for this mission."""

import xarray as xr

from gliderhpc.report.page.content import Entry, Index, Section, Words
from gliderhpc.report.studies.registry import studies_in

PUBLISHED = (
    ("Figure 1", "forward model against the records, and its error over the mission", "validation"),
    ("Figure 2", "motion reconstructed and measured", "reconstruction"),
    ("Figure 3", "yaw moment by adjoint and filter", "reconstruction"),
    ("Table 1", "exponents of the spectra by depth", "spectra"),
    ("Figure 4", "spectra of the yaw moment, from calm to harsh", "spectra"),
    ("Table 2", "cost and accuracy of the reconstruction", "reconstruction"),
    ("Figure 5", "length of the windows, on twin experiments", "windows"),
    ("Table 3", "missions without turbulence", "nulls"),
    ("Figure 6", "flatness and exponents beside surrogates", "intermittency"),
    ("Figure 7", "depth-resolved current of a profile", "currents"),
    ("Figure 8", "depth-averaged current beside ocean models", "reanalysis"),
    ("Table 4", "the same in numbers", "reanalysis"),
    ("Figure 9", "drift of the six disturbances", "drift"),
    ("Table 5", "statistics of the drift", "drift"),
    ("Table 6", "robustness of the drift", "drift"),
)
"""Name, what it shows, and the study that makes it, which is the anchor of its section."""


def published_section(archive: xr.DataTree, with_windows: bool) -> Section:
    """The publication's figures and tables, each with its place on the page or why it has none."""
    present = [*studies_in(archive), *(["windows"] if with_windows else [])]
    entries = tuple(
        Entry(name, what, study, "" if study in present else "missing; its section says how to make it")
        for name, what, study in PUBLISHED
    )
    words = Words("The publication's figures and tables as this mission gives them.")
    return Section("published", "Where to find the publication's figures and tables", (words, Index(entries)))
