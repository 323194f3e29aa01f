"""What the tables and figures of the drift are made from, and what they do not prove."""

from collections.abc import Sequence

import pandas as pd

from gliderhpc.report.captions import ESTIMATES, data_said
from gliderhpc.studies.drift.change_text import change_lines
from gliderhpc.studies.drift.drag import OTHER_CAUSES
from gliderhpc.studies.drift.found import DriftFindings
from gliderhpc.studies.drift.settings import DriftSettings
from gliderhpc.studies.provenance import Provenance


def captions(
    made: Provenance, table: pd.DataFrame, found: DriftFindings, settings: DriftSettings, band: Sequence[float],
    segments: int,
) -> dict[str, str]:  # fmt: skip
    """Captions by stem."""
    epochs = int(table["epoch"].nunique())
    data = f"{data_said(made)} in {epochs} epochs, steady glide between {band[0]:.0f} and {band[1]:.0f} m"
    reference = found.verdict.drags[0].reference
    whose = " and ".join(ESTIMATES[own.estimate] for own in found.primary)
    shown = [f"{channel} {phase} ({own.estimate})" for own in found.primary for channel, phase in own.shown]
    robust = (
        f"A drift counts as shown where the block-bootstrap Mann-Kendall test, after Holm's correction, and the "
        f"slope's interval ({settings.resamples} draws of epochs) agree: {', '.join(shown) or 'nowhere'}."
    )
    changes = " ".join(f"{line[0].upper()}{line[1:]}." for line in change_lines(found.changes, reference))
    low, high = (100.0 * end / found.verdict.drags[0].reference for end in found.verdict.interval)
    return {
        "figure_9": (
            f"Medians of the six disturbances over the mission by {whose}, dive and climb apart: {data}. {robust} "
            f"Axial and heave force are weakly observed: their levels rest on prior and coefficients. {changes}"
        ),
        "drag": (
            f"Change of K_D0 that the disturbances are equivalent to, by {whose}: {data}. What dive and climb share is "
            f"{100.0 * found.verdict.change / found.verdict.drags[0].reference:+.1f} % of K_D0 over the mission (95 % "
            f"interval {low:+.1f} to {high:+.1f} %). {OTHER_CAUSES[0].upper()}{OTHER_CAUSES[1:]}. {changes}"
        ),
        "changes": (
            f"Steps, ramps and episodes of axial force and drag on dives, climbs and both together, by {whose}: "
            f"{data_said(made)}; a row a change and part of the dive. They count below p = {settings.changes.level:g}, "
            f"by {settings.changes.resamples} bootstrap missions over all positions, lengths and series. {changes}"
        ),
        "medians": (
            f"A row a profile: medians of every disturbance and of the equivalent K_D0 by every estimate, the filter's "
            f"beside: {data}. A median of fewer records than needed is left out."
        ),
        "table_5": (
            f"Trends of the twelve series of every estimate, the paper's grade beside the robust verdict: {data}. "
            f"{robust}"
        ),
        "table_6": (
            f"Slopes under {settings.coefficients.draws} hulls whose coefficients are off by up to "
            f"{settings.coefficients.error:.0%}, and with the pitch off by {settings.coefficients.pitch_offset:g} "
            f"degree: {segments} steady segments of {settings.coefficients.length:g} s, inverted anew by the adjoint, "
            f"of {data}. The segments are a sample of the record; errors that all hulls share are not in the draws."
        ),
    }
