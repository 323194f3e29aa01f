"""Study ``nulls``: figure, Table 3, verdict and captions, from its group and ``intermittency`` of an archive."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from gliderhpc.archive.reader import Archive
from gliderhpc.findings.drawing import FILTER, MODEL, SMOOTHER, TRUTH, label, legend, panels
from gliderhpc.findings.formatting import number
from gliderhpc.findings.results import Findings, archive_findings
from gliderhpc.report.studies.summaries import describe_data
from gliderhpc.report.studies.turbulence import (
    LABELS,
    describe_series,
    ensemble_comparisons,
    table_3,
    table_3_caption,
    table_3_text,
    unit_of,
    verdict_text,
)
from gliderhpc.store_schema.columns import GAUSSIAN, MODEL_ERROR, NOISE_ONLY
from gliderhpc.studies.archived import Provenance, mission_of, provenance_of
from gliderhpc.studies.library.turbulence.ensembles import Ensembles, is_comparable, null_table, stored_measured
from gliderhpc.studies.library.turbulence.verdict import SHE_LEVEQUE, TOLERANCE, judge
from gliderhpc.studies.nulls import NAME, NullSettings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STYLES = {NOISE_ONLY: (MODEL, "s"), MODEL_ERROR: (FILTER, "^"), GAUSSIAN: (SMOOTHER, "D")}
"""Colour and marker of each family."""


def show(archive: Archive) -> Findings:
    """Make tables, comparisons, figure and captions of an archive's nulls, with comparable measured profiles."""
    provenance, nulls = provenance_of(archive, NAME), null_table(archive)
    settings = NullSettings.model_validate(provenance.settings)
    measured, remarks = _comparable_profiles(archive, provenance, settings)
    ensembles = Ensembles(measured, nulls, settings.statistics)
    verdict = judge(ensembles)
    facts = {
        "estimate": provenance.estimate,
        "quick": provenance.quick,
        "settings": settings.model_dump(mode="json"),
        "ceiling": ensembles.ceiling,
        "verdict": verdict.as_json() if len(measured) else None,
    }
    messages = nulls["message"].dropna()
    if len(messages):
        remarks = (*remarks, f"{len(messages)} of {len(nulls)} nulls have no statistics: {messages.iloc[0]}")
    text = table_3_text(ensembles)
    if len(measured):
        remarks = (*remarks, verdict.sentence)
        text += "\n" + verdict_text(verdict)
    known = np.isfinite(nulls["peak"]).any()
    return archive_findings(
        NAME,
        comparisons=ensemble_comparisons(ensembles),
        tables={"nulls": nulls[list(provenance.columns)], "table_3": table_3(ensembles)},
        figures={"nulls": partial(nulls_figure, ensembles, mission_of(archive))} if known else {},
        facts=facts,
        failed={},
        remarks=remarks,
        captions=_captions(provenance, ensembles, settings),
        documents={"verdict.md": text},
    )


def _comparable_profiles(
    archive: Archive, provenance: Provenance, settings: NullSettings
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Return the measured profiles of the same estimate and settings, and the remarks."""
    measured, of_measured = stored_measured(archive, provenance.estimate)
    if of_measured is not None and is_comparable(of_measured.model_dump(mode="json"), settings.statistics):
        return measured, provenance.remarks
    alone = "the archive contains no intermittency of this estimate and these settings: the nulls are shown alone"
    return pd.DataFrame(), (*provenance.remarks, alone)


def _captions(provenance: Provenance, ensembles: Ensembles, settings: NullSettings) -> dict[str, str]:
    """Return the captions: data of figure and tables, and the small number of realisations."""
    artefact_count, unit = len(ensembles.artefacts), unit_of(ensembles.settings.channel)
    nulls = (
        f"{len(ensembles.nulls)} missions without turbulence, flown under the recorded actuation of "
        f"{describe_data(provenance)} and inverted as the archive was"
    )
    text = (
        f"Statistics of {describe_series(provenance, ensembles.settings)}: {nulls}; for the model error, coefficients "
        f"are wrong by up to {settings.spread:.0%}. The ceiling, {number(ensembles.ceiling)} {unit}, is the largest "
        f"amplitude of {artefact_count} realisations with noise or model error alone: more realisations can only "
        "raise it, and artefacts of other kinds are not included."
    )
    return {
        # One text serves the figure and its table, which have the same name.
        "nulls": f"{text} Compared with {len(ensembles.measured)} measured profiles.",
        "table_3": table_3_caption(provenance, ensembles),
    }


def nulls_figure(ensembles: Ensembles, title: str) -> Figure:
    """Draw (a) relative exponent over largest amplitude and (b) flatness over the exponent of the spectrum."""
    settings = ensembles.settings
    figure, (exponents, spectra) = panels(1, 2, (10.5, 5.0), f"{settings.channel}, measured and nulls: {title}")
    for axes, columns in ((exponents, ("peak", "zeta_ratio")), (spectra, ("beta_resolved", "flatness"))):
        for family, style in _STYLES.items():
            _draw_points(axes, ensembles.family(family), columns, style, LABELS[family])
        _draw_points(axes, ensembles.measured, columns, (TRUTH, "o"), "measured")
    exponents.axhspan(SHE_LEVEQUE - TOLERANCE, SHE_LEVEQUE + TOLERANCE, color="#999999", alpha=0.3, linewidth=0.0)
    if np.isfinite(ensembles.ceiling):
        exponents.axvline(ensembles.ceiling, color=TRUTH, linewidth=0.7, linestyle="--", label="null ceiling")
    exponents.set_xscale("log")
    spectra.set_yscale("log")
    unit = unit_of(settings.channel)
    label(exponents, "(a) band: She-Leveque within 0.05", f"largest amplitude ({unit})", "zeta_6 / zeta_3 (1)")
    label(spectra, "(b)", "exponent of the spectrum, resolved part (1)", f"flatness over {settings.lag:g} s (1)")
    legend(exponents)
    legend(spectra)
    return figure


def _draw_points(axes: Axes, table: pd.DataFrame, columns: tuple[str, str], style: tuple[str, str], name: str) -> None:
    (x, y), (colour, marker) = columns, style
    if len(table):
        axes.plot(table[x], table[y], marker, color=colour, markersize=4.5, alpha=0.8, label=f"{name} ({len(table)})")
