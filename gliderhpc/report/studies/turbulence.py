"""Captions, remarks, Table 3 and verdict, shared by the studies of turbulence."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.formatting import markdown, number
from gliderhpc.report.studies.summaries import describe_data, estimate_label
from gliderhpc.store_schema.columns import (
    FAMILIES,
    GAUSSIAN,
    MODEL_ERROR,
    NOISE_ONLY,
    actuated_column,
    surrogate_columns,
)
from gliderhpc.studies.archived import Provenance, failed_profiles
from gliderhpc.studies.library.turbulence.ensembles import Ensembles
from gliderhpc.studies.library.turbulence.series import FastSettings
from gliderhpc.studies.library.turbulence.verdict import (
    ASSUMPTIONS,
    SHE_LEVEQUE,
    TOLERANCE,
    TurbulenceVerdict,
    conclusion,
)
from gliderhpc.wording import capitalised

MEASURED, MEASURED_ALL, SURROGATES = "measured", "measured_all", "surrogates"

LABELS = {
    MEASURED: "measured",
    MEASURED_ALL: "measured, actuated samples included",
    SURROGATES: "surrogates",
    NOISE_ONLY: "noise only",
    MODEL_ERROR: "model error",
    GAUSSIAN: "Gaussian disturbances of the measured spectra",
}
"""Labels of the ensembles."""

STATISTICS = {
    "flatness": "F({lag:g} s)",
    "zeta_ratio": "zeta_6 / zeta_3",
    "kurtosis": "kurtosis",
    "peak": "largest amplitude, {unit}",
    "beta": "beta",
    "beta_resolved": "beta, resolved",
}
"""Columns of Table 3, from group `intermittency`, with their headings."""

PAPER: dict[str, dict[str, tuple[float, float]]] = {
    MEASURED: {
        "flatness": (57.0, 448.0), "zeta_ratio": (1.72, 1.82), "kurtosis": (30.0, 187.0), "peak": (0.36, 2.98),
        "beta": (3.4, 5.6),
    },
    SURROGATES: {"flatness": (30.0, 221.0), "zeta_ratio": (1.85, 1.98)},
    NOISE_ONLY: {
        "flatness": (18.0, 87.0), "zeta_ratio": (0.85, 1.98), "kurtosis": (13.0, 43.0), "peak": (0.0, 0.24),
        "beta": (2.4, 5.8),
    },
    MODEL_ERROR: {
        "flatness": (16.0, 52.0), "zeta_ratio": (0.46, 1.99), "kurtosis": (14.0, 40.0), "peak": (0.0, 0.48),
        "beta": (2.4, 5.2),
    },
}  # fmt: skip
"""Values of the paper's Table 3."""

Columns = dict[str, NDArray[np.float64]]


def unit_of(channel: str) -> str:
    """Return the unit of a channel."""
    return "N" if channel in ("B_cu", "B_cv", "B_cw") else "N m"


# Captions and remarks


def describe_series(provenance: Provenance, settings: FastSettings) -> str:
    """Describe the series studied."""
    return f"{settings.channel} by {estimate_label(provenance)}, its part faster than {settings.cutoff:g} Hz"


def describe_resolution(table: pd.DataFrame, settings: FastSettings) -> str:
    """Describe how much of the band the records resolve, for a caption."""
    low, high = settings.band
    nyquist = _usual_nyquist(table)
    if nyquist >= high:
        return f"The records resolve the whole band of {low:g} to {high:g} Hz."
    return (
        f"The records resolve only up to {nyquist:.2g} Hz of the band of {low:g} to {high:g} Hz (median); higher "
        "frequencies contain only interpolation and effects of the windows."
    )


def _usual_nyquist(table: pd.DataFrame) -> float:
    """Return the median Nyquist frequency of the profiles studied, or of all if none could be; Hz."""
    _, studied = failed_profiles(table)
    return float((studied if len(studied) else table)["nyquist"].median())


def band_remarks(table: pd.DataFrame, settings: FastSettings, step: float) -> tuple[str, ...]:
    """Describe the part of the band resolved by the records, and the upper end of a series sampled every `step` (s)."""
    low, high = settings.band
    nyquist = _usual_nyquist(table)
    if nyquist >= high:
        return ()
    resolved = f"its part from {low:g} to {nyquist:.3g} Hz" if nyquist > low else "nothing in this band"
    remark = f"the band reaches from {low:g} to {high:g} Hz; the records resolve {resolved}"
    if nyquist > low:
        remark += (
            ": higher frequencies contain only interpolation and effects of the windows, which partly determine the "
            "exponent on the band"
        )
    if 0.5 / step < high - 1e-9:
        remark += (
            f"; the series ends at {0.5 / step:g} Hz ({step:g} s apart), so no exponent is given on the whole band"
        )
    return (remark,)


def table_3_caption(provenance: Provenance, ensembles: Ensembles) -> str:
    """Return the caption of Table 3."""
    families = [f"{len(ensembles.family(name))} {LABELS[name]}" for name in FAMILIES]
    nulls = f"nulls without turbulence ({', '.join(families)})" if len(ensembles.nulls) else "no nulls, as none fit"
    return (
        f"Minimum and maximum of each statistic of {describe_series(provenance, ensembles.settings)}: "
        f"{len(ensembles.measured)} measured profiles and {ensembles.settings.surrogates} surrogates of each, and "
        f"{nulls}; data: {describe_data(provenance)}. Ranges grow with the number of members, and an overlap with the "
        "nulls leaves the question open."
    )


# Table 3


def table_3(ensembles: Ensembles) -> pd.DataFrame:
    """Return the paper's Table 3 for any profiles: minimum and maximum of each statistic, one row per ensemble."""
    rows: list[dict[str, Any]] = []
    for name, columns in _ensemble_columns(ensembles):
        row: dict[str, Any] = {"ensemble": name, "count": len(next(iter(columns.values()), ()))}
        for statistic, column in columns.items():
            known = column[np.isfinite(column)]
            least, most = _range_columns(statistic)
            row[least] = float(known.min()) if known.size else float("nan")
            row[most] = float(known.max()) if known.size else float("nan")
        rows.append(row)
    return pd.DataFrame(rows)


def table_3_text(ensembles: Ensembles) -> str:
    """Format the ranges, with those of the paper in brackets."""
    unit = unit_of(ensembles.settings.channel)
    heads = [text.format(lag=ensembles.settings.lag, unit=unit) for text in STATISTICS.values()]
    lines = [
        [LABELS[str(row["ensemble"])], str(row["count"])] + [_range_cell(row, statistic) for statistic in STATISTICS]
        for _, row in table_3(ensembles).iterrows()
    ]
    return (
        "# Intermittency and nulls\n\nRanges over each ensemble; those of the paper, from its own ensembles, in "
        "brackets.\n\n" + markdown(("ensemble", "number", *heads), lines, heads) + "\n"
    )


def ensemble_comparisons(ensembles: Ensembles) -> tuple[Comparison, ...]:
    """Compare medians and ranges of each ensemble with the paper's ranges."""
    return tuple(
        _ensemble_comparison(ensembles, name, statistic, column[np.isfinite(column)])
        for name, columns in _ensemble_columns(ensembles)
        for statistic, column in columns.items()
    )


def _ensemble_comparison(ensembles: Ensembles, name: str, statistic: str, known: NDArray[np.float64]) -> Comparison:
    label = STATISTICS[statistic].format(lag=ensembles.settings.lag, unit="").rstrip(", ")
    return Comparison(
        f"{label}, {LABELS[name]}",
        unit_of(ensembles.settings.channel) if statistic == "peak" else "1",
        float(np.median(known)) if known.size else float("nan"),
        PAPER.get(name, {}).get(statistic),
        (float(known.min()), float(known.max())) if known.size else None,
        remark=f"median and range of {known.size}",
    )


def _ensemble_columns(ensembles: Ensembles) -> Iterator[tuple[str, Columns]]:
    """Yield each ensemble with values of the statistics; those of the surrogates are the ends of their envelopes."""
    measured = ensembles.measured
    if len(measured):
        yield MEASURED, {name: measured[name].to_numpy() for name in STATISTICS}
        yield MEASURED_ALL, {name: measured[actuated_column(name)].to_numpy() for name in STATISTICS}
        yield (
            SURROGATES,
            {name: measured[[*surrogate_columns(name)]].to_numpy().ravel() for name in ("flatness", "zeta_ratio")},
        )
    for family in FAMILIES:
        own = ensembles.family(family)
        if len(own):
            yield family, {name: own[name].to_numpy(dtype=np.float64) for name in STATISTICS}


def _range_columns(statistic: str) -> tuple[str, str]:
    """Return the columns of Table 3 for a statistic."""
    return f"{statistic}_least", f"{statistic}_most"


def _range_cell(row: pd.Series, statistic: str) -> str:
    least, most = (float(row.get(column, np.nan)) for column in _range_columns(statistic))
    if not np.isfinite(least):
        return "preserved" if row["ensemble"] == SURROGATES else "–"
    own = f"{number(least)} to {number(most)}"
    paper = PAPER.get(str(row["ensemble"]), {}).get(statistic)
    return own if paper is None else f"{own} [{number(paper[0])} to {number(paper[1])}]"


# Verdict


def verdict_text(verdict: TurbulenceVerdict) -> str:
    """Format the verdict with the assumptions of its joint statement."""
    rows = [(feature.name, feature.outcome, feature.figures) for feature in verdict.features]
    statement = "no nulls, so no joint statement"
    if np.isfinite(verdict.joint):
        statement = (
            f"Share of the nulls' zeta_6 / zeta_3 within {TOLERANCE:g} of {SHE_LEVEQUE:.2f}, one added to both "
            f"counts: {number(verdict.inside)}. If those of the profiles were drawn from the same distribution, all "
            f"{verdict.profiles} would lie there with a probability of {verdict.joint:.1e}."
        )
    assumptions = "\n".join(f"- {text}" for text in ASSUMPTIONS)
    return (
        f"## Verdict\n\n{' '.join(conclusion(verdict))}\n\n{capitalised(verdict.sentence)}.\n\n"
        + markdown(("feature", "outcome", "figures"), rows)
        + f"\n\n{statement}\n\nAssumptions:\n\n{assumptions}\n"
    )
