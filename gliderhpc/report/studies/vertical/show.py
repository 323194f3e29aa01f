"""Tables, comparisons, figures and captions of study ``vertical``, from its group of an archive alone."""

import pandas as pd
import xarray as xr

from gliderhpc.archive.profile import goes_by_density
from gliderhpc.findings.findings import Findings, archive_findings
from gliderhpc.report.captions import data_said
from gliderhpc.report.studies.vertical.figure import vertical_figure
from gliderhpc.report.studies.vertical.table import comparisons, remarks_on
from gliderhpc.studies.archived import (
    column_medians,
    failed_profiles,
    platform_of,
    study_table,
)
from gliderhpc.studies.provenance import Provenance, provenance_of
from gliderhpc.studies.vertical.profile import LEVELS
from gliderhpc.studies.vertical.study import NAME
from gliderhpc.studies.vertical.velocity import HullErrors, hull_errors


def show(archive: xr.DataTree) -> Findings:
    """Show the study of an archive."""
    made, table = provenance_of(archive, NAME), study_table(archive, NAME)
    failed, known = failed_profiles(table)
    by_density = any(goes_by_density(archive, number) for number in made.profiles)
    errors = hull_errors(platform_of(archive), by_density=by_density)
    facts = {
        "profiles": list(made.profiles),
        "quick": made.quick,
        "hull_errors": "of the calibration" if errors.calibrated else "plausible deviations",
        "medians": column_medians(known),
    }
    return archive_findings(
        NAME, comparisons(known, errors), {"profiles": table}, {"vertical": vertical_figure(archive, known)}, facts,
        failed, made.remarks + remarks_on(known, errors),
        captions=_captions(made, known, errors, by_density=by_density),
    )  # fmt: skip


def _captions(made: Provenance, known: pd.DataFrame, errors: HullErrors, *, by_density: bool) -> dict[str, str]:
    """Say what figure and table are made from, and how far either is the hull's."""
    data = data_said(made, known["profile"].tolist())
    buoyancy = "by measured density" if by_density else "by its depth slope"
    window, share = float(known["window"].median()), float(known["share"].median())
    whose = "as its calibration states them" if errors.calibrated else "plausible ones, as no calibration states them"
    deviations = [float(known[name].median()) for name in ("mean_std_dive", "mean_std_climb") if name in known]
    sure = (
        f"Deviations hold the depth sensor's noise, rounded pitch and errors of the hull's numbers ({whose}): the "
        f"latter shift the mean of a leg by {100.0 * max(deviations, default=float('nan')):.2g} cm/s (median)."
    )
    return {
        "vertical": (
            f"Vertical velocity of the water: measured depth rate less that of the hull's glide in still water, its "
            f"buoyancy {buoyancy}, over windows of {window:.0f} s. Panels (a) and (b): profile "
            f"{int(known['profile'].iloc[0])}; (c) and (d): {data}. {sure}"
        ),
        "profiles": (
            f"A row a profile: {data}; {share:.0%} of the samples have a velocity (median), the others lie in the "
            f"vibration set, in gaps or near the surface. Dives less climbs are taken at the same {LEVELS} levels, and "
            f"water that is the same on both leaves nothing. {sure}"
        ),
    }
