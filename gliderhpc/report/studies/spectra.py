"""Study ``spectra``: Table 1, Figure 4, comparisons and captions, from its group of an archive alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.archive.reader import Archive
from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.drawing import FILTER, MODEL, SHADE, SMOOTHER, footnote, label, legend, panel_letters, panels
from gliderhpc.findings.formatting import markdown, number
from gliderhpc.findings.results import Findings, archive_findings, as_plain
from gliderhpc.report.studies.summaries import describe_data, median_of, shared_facts
from gliderhpc.report.studies.turbulence import band_remarks, describe_resolution, describe_series
from gliderhpc.store_schema.columns import BETA, BETA_RESOLVED, PARTS, WHOLE, extent_columns, fit_columns
from gliderhpc.studies.archived import Provenance, failed_profiles, mission_of, provenance_of, study_table
from gliderhpc.studies.library.turbulence.series import SpectraSettings, series_step
from gliderhpc.studies.spectra import NAME
from gliderhpc.wording import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KOLMOGOROV = 11.0 / 3.0
"""Exponent of Kolmogorov's velocity spectrum with the paper's factor f^-2 for the hull's response."""

PAPER = {"whole": (4.33, 5.72), "shallow": (4.01, 6.97), "middle": (3.53, 5.13), "deep": (2.61, 4.98)}
"""Ranges from the paper's Table 1, by part."""

PAPER_GROUPS = {"calm": 5.53, "middle": 4.27, "harsh": 3.86}
"""Means of the paper by group of profiles."""

PAPER_R2 = 0.91
"""Coefficient of determination that all fits of the paper exceed."""

WHOLE_BETA = fit_columns(BETA).exponent
WHOLE_BETA_RESOLVED = fit_columns(BETA_RESOLVED).exponent
BETA_ALL = fit_columns(BETA, None).exponent

_COLOURS = (MODEL, FILTER, SMOOTHER, "#CC79A7", "#56B4E9", "#E69F00")

_MAX_NAMED = 6
"""Maximum number of profiles named in a panel; others are drawn thin and grey."""


def show(archive: Archive) -> Findings:
    """Make tables, comparisons, figure and captions of the study of an archive."""
    provenance, table = provenance_of(archive, NAME), study_table(archive, NAME)
    settings = SpectraSettings.model_validate(provenance.settings)
    failed, studied = failed_profiles(table)
    facts = shared_facts(provenance) | {
        "settings": settings.model_dump(mode="json"),
        "group_means": as_plain(_group_means(studied)),
    }
    by_depth = table_1(studied)
    return archive_findings(
        NAME,
        comparisons=comparisons(studied),
        tables={"table_1": pd.DataFrame(by_depth), "profiles": table},
        figures={"figure_4": partial(figure_4, archive, studied, settings)} if len(studied) else {},
        facts=facts,
        failed=failed,
        remarks=provenance.remarks + band_remarks(table, settings, series_step(archive, provenance.estimate)),
        captions=_captions(provenance, table, studied, settings),
        documents={"table_1.md": table_1_text(by_depth)} if by_depth else {},
    )


# Captions


def _captions(
    provenance: Provenance, table: pd.DataFrame, studied: pd.DataFrame, settings: SpectraSettings
) -> dict[str, str]:
    """Return the captions: data of figure and tables, and the highest frequency that the records resolve."""
    low, high = settings.band
    series, data = describe_series(provenance, settings), describe_data(provenance, studied["profile"].tolist())
    resolved = describe_resolution(table, settings)
    exponents = (
        f"Exponents of the spectrum of {series}, of each profile and of its thirds by depth: {data}. 95 % intervals "
        f"are by {settings.draws} draws of Welch's segments; they include scatter alone, not errors of the estimate's "
        "own response."
    )
    return {
        "figure_4": (
            f"Power spectra of {series}: {data}, in groups by the speed of their depth-averaged current, each "
            f"spectrum divided by its variance above the cutoff; Welch's segments of {settings.segment:g} s. "
            f"Exponents are fitted over {low:g} to {high:g} Hz (dotted) and over the part of this band that the "
            f"records resolve. {resolved}"
        ),
        "table_1": f"{exponents} {resolved}",
        "profiles": f"One row per profile. {exponents} {resolved}",
    }


def _group_means(table: pd.DataFrame) -> dict[str, dict[Any, Any]]:
    """Return the mean exponents and the mean current speed of each group."""
    names = [name for name in (WHOLE_BETA, WHOLE_BETA_RESOLVED, "speed") if name in table]
    return {str(group): own[names].mean().to_dict() for group, own in table.groupby("group")} if len(table) else {}


# Table 1 and the comparisons


def table_1(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the paper's Table 1 for any profiles: exponents and coefficients of determination by profile and part."""
    return [_table_1_row(row, part) for _, row in table.iterrows() for part in PARTS]


def table_1_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """Format the table as Markdown."""
    lines = [[number(cell) if isinstance(cell, float) else str(cell) for cell in row.values()] for row in rows]
    columns = list(rows[0]) if rows else []
    return (
        "# Exponents by depth\n\nOn the band of the fit, and on the part that the records resolve; 95 % "
        "intervals by a bootstrap of Welch's segments.\n\n" + markdown(columns, lines, columns[3:]) + "\n"
    )


def _table_1_row(row: pd.Series, part: str) -> dict[str, Any]:
    def value(column: str) -> float:
        return float(row.get(column, np.nan))

    def fit(exponent: str, head: str) -> dict[str, Any]:
        columns = fit_columns(exponent, part)
        interval = f"{number(value(columns.low))} to {number(value(columns.high))}"
        return {head: value(columns.exponent), f"{head}, 95 %": interval, f"{head}, R2": value(columns.r2)}

    extent = extent_columns(part)
    return {
        "profile": int(row["profile"]),
        "group": str(row["group"]),
        "part": part,
        "depth, m": f"{number(value(extent.shallowest))} to {number(value(extent.deepest))}",
        **fit(BETA, "beta"),
        **fit(BETA_RESOLVED, "beta resolved"),
    }


def comparisons(table: pd.DataFrame) -> tuple[Comparison, ...]:
    """Compare medians of the exponents with the paper's ranges, and the groups' means with its means."""
    return (
        *(_part_comparison(table, part) for part in PARTS),
        *_group_comparisons(table),
        Comparison(
            "exponent on the resolved part, whole profile",
            "1",
            median_of(table, WHOLE_BETA_RESOLVED),
            spread=_range(table, WHOLE_BETA_RESOLVED),
            remark="the paper gives none; spread is the range",
        ),
        Comparison(
            "exponent with actuated samples included",
            "1",
            median_of(table, BETA_ALL),
            spread=_range(table, BETA_ALL),
            remark="spread is the range",
        ),
        Comparison("Kolmogorov's with the paper's f^-2", "1", KOLMOGOROV, KOLMOGOROV),
        Comparison("smallest R2 of any part", "1", _least_r2(table), PAPER_R2, paper_text="> 0.91"),
    )


def _part_comparison(table: pd.DataFrame, part: str) -> Comparison:
    column = fit_columns(BETA, part).exponent
    name = "whole profile" if part == WHOLE else f"{part} third"
    return Comparison(
        f"exponent, {name}, median",
        "1",
        median_of(table, column),
        PAPER[part],
        _range(table, column),
        remark="spread is the range",
    )


def _group_comparisons(table: pd.DataFrame) -> list[Comparison]:
    if WHOLE_BETA not in table:
        return []
    own = {group: table.loc[table["group"] == group, WHOLE_BETA] for group in PAPER_GROUPS}
    return [
        Comparison(
            f"exponent, mean of the {group} profiles",
            "1",
            float(own[group].mean()),
            paper,
            remark=counted(len(own[group]), "profile"),
        )
        for group, paper in PAPER_GROUPS.items()
        if len(own[group])
    ]


def _least_r2(table: pd.DataFrame) -> float:
    columns = [column for part in PARTS if (column := fit_columns(BETA, part).r2) in table]
    return float(table[columns].min().min()) if columns else float("nan")


def _range(table: pd.DataFrame, column: str) -> tuple[float, float] | None:
    if column not in table or not table[column].notna().any():
        return None
    return float(table[column].min()), float(table[column].max())


# Figure 4


def figure_4(archive: Archive, table: pd.DataFrame, settings: SpectraSettings) -> Figure:
    """Draw Figure 4 of the paper for any profiles: spectra by group, with the band and its resolved part.

    Each panel is a group, from calm to harsh; each spectrum is normalised by its variance above the cutoff.
    """
    groups = list(dict.fromkeys(table.sort_values("speed")["group"]))
    title = f"Spectra of {settings.channel}, fast part: {mission_of(archive)}"
    figure, axes = panels(1, len(groups), (max(5.0, 3.9 * len(groups)), 4.8), title)
    study = archive[NAME].to_dataset()
    for panel, group, letter in zip(axes, groups, panel_letters(len(groups)), strict=True):
        own = table[table["group"] == group]
        _draw_group(panel, study, own, settings)
        label(panel, f"({letter}) {group}: {_speeds(own)}", "frequency (Hz)", "density over variance (1/Hz)")
        legend(panel)
    footnote(
        figure,
        "Grey: above the records' Nyquist frequency, where the series contains only the interpolation between samples "
        "and effects of the windows.",
    )
    return figure


def _speeds(own: pd.DataFrame) -> str:
    if not own["speed"].notna().any():
        return "current not known"
    return f"{100 * own['speed'].min():.0f} to {100 * own['speed'].max():.0f} cm/s"


def _draw_group(axes: Axes, study: xr.Dataset, own: pd.DataFrame, settings: SpectraSettings) -> None:
    top, bottom = 0.0, np.inf
    for index, (_, row) in enumerate(own.iterrows()):
        at = study.sel(profile=int(row["profile"]))
        frequency, density = at["frequency_hz"].values, at["density"].values
        shown = (frequency >= settings.cutoff) & np.isfinite(density)
        if not shown.any():
            continue
        variance = float(np.sum(density[shown]) * (frequency[1] - frequency[0]))
        normalised = density[shown] / variance
        if index < _MAX_NAMED:
            axes.loglog(frequency[shown], normalised, color=_COLOURS[index], linewidth=0.9, label=_name(row))
        else:
            axes.loglog(frequency[shown], normalised, color=SHADE, linewidth=0.4)
        top = max(top, float(np.max(normalised)))
        bottom = min(bottom, float(np.percentile(normalised, 2.0)))
        nyquist, end = float(row["nyquist"]), float(frequency[-1])
        if nyquist < end:
            axes.axvspan(nyquist, end, color=SHADE, alpha=0.08, linewidth=0.0, zorder=0.1)
    if top == 0.0:
        axes.text(0.5, 0.5, "no spectrum", ha="center", transform=axes.transAxes, fontsize=8)
        return
    band = np.array(settings.band)
    axes.loglog(band, 0.3 * top * (band / band[0]) ** -KOLMOGOROV, "-.", color="black", linewidth=1.0, label="-11/3")
    for end in band:
        axes.axvline(end, color="black", linewidth=0.5, linestyle=":")
    axes.set_ylim(0.1 * bottom, top * 3.0)


def _name(row: pd.Series) -> str:
    return f"{row['profile']}: {row[WHOLE_BETA]:.2f}, resolved {row[WHOLE_BETA_RESOLVED]:.2f}"
