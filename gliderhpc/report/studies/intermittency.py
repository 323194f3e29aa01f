"""Study ``intermittency``: Figure 6, Table 3, verdict and captions, from an archive's groups of study and nulls."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.archive.reader import Archive
from gliderhpc.findings.drawing import MODEL, SHADE, footnote, label, legend, panels
from gliderhpc.findings.results import Findings, archive_findings
from gliderhpc.report.studies.summaries import describe_data, shared_facts
from gliderhpc.report.studies.turbulence import (
    band_remarks,
    describe_resolution,
    describe_series,
    ensemble_comparisons,
    table_3,
    table_3_caption,
    table_3_text,
    verdict_text,
)
from gliderhpc.store_schema.columns import FLATNESS_BY_LAG, NOISE_MOMENTS, RANGE_STATISTICS, ZETA, range_column
from gliderhpc.studies.archived import Provenance, failed_profiles, mission_of, provenance_of, study_table
from gliderhpc.studies.intermittency import NAME
from gliderhpc.studies.library.turbulence.ensembles import Ensembles, stored_nulls
from gliderhpc.studies.library.turbulence.gaussianity import describe_untested
from gliderhpc.studies.library.turbulence.series import IntermittencySettings, series_step
from gliderhpc.studies.library.turbulence.statistics import ORDERS
from gliderhpc.studies.library.turbulence.verdict import TurbulenceVerdict, judge
from gliderhpc.vocabulary import she_leveque

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MAX_DRAWN = 9
"""Maximum number of profiles in the figure."""

_STYLES = ("-", "--", ":")
_COLOURS = (MODEL, "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def show(archive: Archive) -> Findings:
    """Make tables, comparisons, figure and captions of the study of an archive, with its nulls if it has any."""
    provenance, table = provenance_of(archive, NAME), study_table(archive, NAME)
    settings = IntermittencySettings.model_validate(provenance.settings)
    failed, studied = failed_profiles(table)
    nulls, null_remarks = stored_nulls(archive, provenance.estimate, settings)
    numbers = studied["profile"].tolist()
    ensembles = Ensembles(studied, nulls, settings)
    verdict = judge(ensembles)
    facts = shared_facts(provenance) | {"settings": settings.model_dump(mode="json"), "verdict": verdict.as_json()}
    tables = {"profiles": table, "ranges": _ranges(archive, numbers), "table_3": table_3(ensembles)}
    if verdict.gaussianity is not None:
        tables["gaussianity"] = _gaussianity(archive, numbers)
    about_band = band_remarks(table, settings, series_step(archive, provenance.estimate))
    return archive_findings(
        NAME,
        comparisons=ensemble_comparisons(ensembles),
        tables=tables,
        figures={"figure_6": partial(figure_6, archive, studied, settings)} if len(studied) else {},
        facts=facts,
        failed=failed,
        remarks=(*provenance.remarks, *about_band, *_noise_remarks(verdict, studied), *null_remarks, verdict.sentence),
        captions=_captions(provenance, table, ensembles),
        documents={"verdict.md": table_3_text(ensembles) + "\n" + verdict_text(verdict)},
    )


def _ranges(archive: Archive, numbers: list[int]) -> pd.DataFrame:
    """Tabulate the relative exponent over every range of lags, one row for each profile and range."""
    group = archive[NAME].to_dataset().sel(profile=numbers)
    columns = {name: group[range_column(name)].values for name in RANGE_STATISTICS}
    first, last = (group[range_column(end)].values.tolist() for end in ("from", "to"))
    ends = list(zip(first, last, strict=True))
    return pd.DataFrame(
        [
            {"profile": number, "from": low, "to": high}
            | {name: float(column[row, at]) for name, column in columns.items()}
            for row, number in enumerate(numbers)
            for at, (low, high) in enumerate(ends)
        ]
    )


def _noise_remarks(verdict: TurbulenceVerdict, studied: pd.DataFrame) -> tuple[str, ...]:
    """Explain why it is not tested whether disturbances are Gaussian, if they have statistics at all."""
    gaussianity = verdict.gaussianity
    if gaussianity is not None and gaussianity.untested:
        return (f"whether lateral disturbances are Gaussian: {describe_untested(gaussianity)}",)
    if gaussianity is not None or not len(studied):
        return ()
    return (
        "the archive has no noise of the smoother, so it is not tested whether lateral disturbances are Gaussian; run "
        "the mission again",
    )


def _gaussianity(archive: Archive, numbers: list[int]) -> pd.DataFrame:
    """Tabulate the moments of the smoother's standardised noise, one row for each profile and channel."""
    group = archive[NAME].to_dataset().sel(profile=numbers)
    table = group[list(NOISE_MOMENTS)].to_dataframe().reset_index()
    return table[["profile", "channel", *NOISE_MOMENTS]]


def _captions(provenance: Provenance, table: pd.DataFrame, ensembles: Ensembles) -> dict[str, str]:
    """Return the captions: data of figure and tables, and the question that remains open."""
    settings = ensembles.settings
    series, data = (
        describe_series(provenance, settings),
        describe_data(provenance, ensembles.measured["profile"].tolist()),
    )
    resolved = describe_resolution(table, settings)
    low, high = settings.scaling
    open_question = "Passing the test excludes only a Gaussian linear process with the same spectrum."
    return {
        "figure_6": (
            f"Flatness by lag and relative exponents of the increments of {series}: {data}, each compared with the "
            f"envelope of {settings.surrogates} surrogates of its spectrum. The lag of the test, {settings.lag:g} s, "
            f"and the range of the fit, {low:g} to {high:g} s, were fixed beforehand; bars are 95 % intervals by a "
            f"bootstrap of blocks of {settings.block:g} s. {open_question} {resolved}"
        ),
        "profiles": (
            f"One row per profile: statistics of {series}, without and with (all) the samples at which actuators "
            f"move: {data}; p is that of a rank test among {settings.surrogates} surrogates, so it is at least "
            f"{1.0 / (1 + settings.surrogates):.3g}. {open_question} {resolved}"
        ),
        "ranges": (
            f"Relative exponent zeta_6 / zeta_3 of {series} over {len(settings.scaling_ranges)} ranges of lags, one "
            f"row per profile and range, with 95 % intervals by {settings.block_draws} draws of blocks of "
            f"{settings.block:g} s: {data}. An exponent that changes with the range is not that of a scaling law."
        ),
        "table_3": table_3_caption(provenance, ensembles),
        "gaussianity": (
            "Moments of the smoother's standardised noise by profile and channel, actuated samples left out: variance, "
            f"kurtosis over the root mean square within {settings.noise_window:g} s, number of independent values, and "
            f"score of the kurtosis under a Gaussian disturbance: {data}. Profiles in which more "
            f"than {settings.most_repeated:.0%} of the samples repeat the roll of the sample before are not tested."
        ),
    }


# Figure 6


def figure_6(archive: Archive, table: pd.DataFrame, settings: IntermittencySettings) -> Figure:
    """Draw Figure 6 of the paper for the profiles of a table.

    Panels are (a) the flatness of the increments by lag and (b) the relative exponents, with the surrogates' envelopes.
    """
    title = f"Increments of {settings.channel}, fast part: {mission_of(archive)}"
    figure, (flatness, exponents) = panels(1, 2, (11.0, 5.4), title)
    study = archive[NAME].to_dataset().sel(profile=table["profile"].tolist()).load()
    _draw_flatness(flatness, study, table, settings)
    _draw_exponents(exponents, study)
    low, high = settings.scaling
    label(flatness, "(a) flatness", "lag (s)", "flatness of the increments (1)")
    label(exponents, f"(b) relative exponents over {low:g} to {high:g} s", "order p", "zeta_p / zeta_3 (1)")
    legend(flatness)
    legend(exponents)
    footnote(
        figure,
        f"Shaded: envelope of {settings.surrogates} surrogates per profile. Grey band: lags shorter than the records' "
        "sample interval, which are not resolved. Bars: 95 % by a block bootstrap.",
    )
    return figure


def _draw_flatness(axes: Axes, study: xr.Dataset, table: pd.DataFrame, settings: IntermittencySettings) -> None:
    for index, number in enumerate(study["profile"].values[:_MAX_DRAWN]):
        at = study.sel(profile=number)
        lag, colour = at["lag_time"].values, _COLOURS[index % len(_COLOURS)]
        style = _STYLES[index // len(_COLOURS) % len(_STYLES)]
        axes.plot(lag, at[FLATNESS_BY_LAG.value], style, color=colour, linewidth=1.1, label=f"profile {number}")
        least, most = at[FLATNESS_BY_LAG.surrogate_least], at[FLATNESS_BY_LAG.surrogate_most]
        axes.fill_between(lag, least, most, color=colour, alpha=0.12, linewidth=0.0)
    axes.axhline(3.0, color="black", linewidth=0.7, linestyle=":", label="Gaussian")
    axes.axvline(settings.lag, color="black", linewidth=0.7, linestyle="--", label="lag of the test")
    axes.set_xscale("log")
    axes.set_yscale("log")
    interval = 0.5 / float(table["nyquist"].median())
    left = axes.get_xlim()[0]
    if interval > left:
        axes.axvspan(left, interval, color=SHADE, alpha=0.2, linewidth=0.0, zorder=0.1)
        axes.set_xlim(left=left)


def _draw_exponents(axes: Axes, study: xr.Dataset) -> None:
    orders = np.array(ORDERS, dtype=np.float64)
    least, most = study[ZETA.surrogate_least].min("profile"), study[ZETA.surrogate_most].max("profile")
    axes.fill_between(orders, least, most, color=SHADE, alpha=0.3, linewidth=0.0, label="surrogates of all profiles")
    for index, number in enumerate(study["profile"].values[:_MAX_DRAWN]):
        at = study.sel(profile=number)
        middle = at[ZETA.value].values
        errors = np.abs(np.stack([at[ZETA.low].values, at[ZETA.high].values]) - middle)
        shift = 0.03 * (index - 0.5 * min(_MAX_DRAWN, study.sizes["profile"]))
        colour = _COLOURS[index % len(_COLOURS)]
        axes.errorbar(orders + shift, middle, yerr=errors, fmt="o", markersize=2.5, linewidth=0.7, color=colour)
    axes.plot(orders, orders / 3.0, "-", color="black", linewidth=0.9, label="K41, p / 3")
    axes.plot(orders, [she_leveque(p) for p in orders], "--", color="black", linewidth=0.9, label="She-Leveque")
