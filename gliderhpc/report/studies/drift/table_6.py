"""Table 6: how far the longitudinal drift rests on the coefficients, and the second witness."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gliderhpc.findings.tables import markdown, number
from gliderhpc.studies.drift.medians import UNITS
from gliderhpc.studies.drift.settings import CoefficientSettings
from gliderhpc.studies.drift.spread import CoefficientSlopes
from gliderhpc.studies.drift.witness import Witness

_COLUMNS = (
    "component", "phase", "all samples", "segments", "95 % of draws", "same sign", "pitch up", "pitch down",
    "shift, pitch up", "shift, pitch down",
)  # fmt: skip


def table_6(slopes: Sequence[CoefficientSlopes], whole: dict[tuple[str, str], float]) -> list[dict[str, Any]]:
    """Rows of the table, slopes a day.

    Parameters
    ----------
    slopes : sequence of CoefficientSlopes
        By the segments.
    whole : dict
        The adjoint's slopes over all samples that count, by quantity and phase.
    """
    return [
        {
            "component": one.quantity, "unit": UNITS[one.quantity], "phase": one.phase,
            "slope_all_samples": whole.get((one.quantity, one.phase), float("nan")), "slope_segments": one.nominal,
            "slope_low": one.interval[0], "slope_high": one.interval[1], "draws": int(np.isfinite(one.draws).sum()),
            "same_sign": one.same_sign, "slope_pitch_up": float(one.pitched[0]),
            "slope_pitch_down": float(one.pitched[1]), "shift_pitch_up": float(one.shift[0]),
            "shift_pitch_down": float(one.shift[1]),
        }
        for one in slopes
    ]  # fmt: skip


def table_6_text(rows: Sequence[dict[str, Any]], settings: CoefficientSettings, witness: Witness | None) -> str:
    """Lay the table out as Markdown, the second witness below it."""
    return _coefficients(rows, settings) + "\n" + _witness(witness)


def _coefficients(rows: Sequence[dict[str, Any]], settings: CoefficientSettings) -> str:
    if not rows:
        return "The coefficients were not drawn (drift.coefficients.draws = 0).\n"
    heading = (
        f"Slopes a day under {settings.draws} hulls whose viscous and added-mass coefficients are off by up to "
        f"{settings.error:.0%}, by the adjoint. Inverted anew, through filter and windows: {settings.segments} steady "
        f"segment(s) of {settings.length:g} s a profile and phase, the first {settings.settling:g} s not counted.\n"
        f"Pitch up and down: slope with the pitch off by a constant {settings.pitch_offset:g} degree; shift: what that "
        "does to the level.\n\n"
    )
    cells = (
        (
            f"{row['component']} ({row['unit']})", str(row["phase"]), number(row["slope_all_samples"]),
            number(row["slope_segments"]), f"{number(row['slope_low'])} to {number(row['slope_high'])}",
            f"{row['same_sign']:.0%} of {row['draws']}" if row["draws"] else "–", number(row["slope_pitch_up"]),
            number(row["slope_pitch_down"]), number(row["shift_pitch_up"]), number(row["shift_pitch_down"]),
        )
        for row in rows
    )  # fmt: skip
    return heading + markdown(_COLUMNS, cells, _COLUMNS[2:]) + "\n"


def _witness(witness: Witness | None) -> str:
    if witness is None:
        return "No second witness: `gliderhpc validate` has not left the forward model's error in the archive.\n"
    one = witness.trend
    return (
        "Error of the forward model, which no adjoint enters: "
        f"{number(one.trend.first)} to {number(one.trend.last)} ({one.trend.change_said}), Mann-Kendall p "
        f"{number(one.trend.p)}, robust p {number(one.robust.p)}; Spearman with the day {witness.with_day.rho:+.2f} (p "
        f"{number(witness.with_day.p)}), with |B_cu| on the climb {witness.with_axial.rho:+.2f} (p "
        f"{number(witness.with_axial.p)}).\n"
    )
