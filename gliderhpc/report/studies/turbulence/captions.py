"""What the captions of these studies share: the series, the band, and what stands beside what in Table 3."""

import pandas as pd

from gliderhpc.report.captions import data_said, estimate_said
from gliderhpc.studies.library.turbulence.ensembles import FAMILIES, Ensembles
from gliderhpc.studies.library.turbulence.settings import FastSettings
from gliderhpc.studies.provenance import Provenance


def series_said(made: Provenance, settings: FastSettings) -> str:
    """Name the series that is studied."""
    return f"{settings.channel} by {estimate_said(made)}, its part faster than {settings.cutoff:g} Hz"


def resolved_said(table: pd.DataFrame, settings: FastSettings) -> str:
    """Say how much of the band the records resolve."""
    low, high = settings.band
    nyquist = float(table["nyquist"].median())
    if nyquist >= high:
        return f"The records resolve the whole band of {low:g} to {high:g} Hz."
    return (
        f"The records resolve no more than {nyquist:.2g} Hz of the band of {low:g} to {high:g} Hz (median); what lies "
        "above is made by interpolation and windows."
    )


def of_table_3(made: Provenance, ensembles: Ensembles) -> str:
    """Caption of Table 3."""
    nulls = [f"{len(ensembles.family(name))} {called}" for name, called in FAMILIES.items()]
    beside = f"nulls without turbulence ({', '.join(nulls)})" if len(ensembles.nulls) else "no nulls, as none fit"
    return (
        f"Least and largest of each statistic of {series_said(made, ensembles.settings)}: {len(ensembles.measured)} "
        f"measured profiles and {ensembles.settings.surrogates} surrogates of each, and {beside}; studied were "
        f"{data_said(made)}. Ranges grow with the number of members, and an overlap with the nulls leaves the "
        "question open."
    )
