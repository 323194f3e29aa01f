"""The figures of ``twin currents`` beside those of sections 5.4 and 5.5."""

from collections.abc import Sequence

from gliderhpc.estimation.current_budget import TERMS
from gliderhpc.estimation.current_errors import CurrentErrors
from gliderhpc.findings.comparison import Comparison
from gliderhpc.studies.library.current_difference import COVERAGE
from gliderhpc.twins.currents.conclusion import line_of
from gliderhpc.twins.currents.coverage import ALL
from gliderhpc.twins.currents.results import FITTED, PUBLISHED, CurrentsResults
from gliderhpc.twins.currents.runs import PRESETS, STILL
from gliderhpc.twins.runs import Row

_UNITS = {"axial_error": "m/s", "relative_error": "1", "heading_error": "degree", "cross_track_error": "m/s"}
LARGEST_ERROR = 0.03
"""Median error of the depth-averaged current that is asked for at most, m/s."""


def compare_averaged(results: CurrentsResults) -> list[Comparison]:
    """Errors, shares inside the ellipses of every set of constants, and the constants fitted."""
    every = line_of(results.coverage, PUBLISHED)
    along, across = results.bias
    rows = [
        Comparison(
            "error of the depth-averaged current, median", "m/s", every["error_median"],
            remark=f"asked: at most {LARGEST_ERROR:g}; {every['twins']} twins",
        ),
        Comparison(
            "mean error along the track", "m/s", along,
            remark=f"with actuators that do not lag their commands {results.lagless_bias[0]:.4f}",
        ),
        Comparison("mean error across the track", "m/s", across),
    ]  # fmt: skip
    for line in results.coverage:
        if line["speed"] == ALL:
            rows += _inside(line)
    fitted, published = results.constants[FITTED], results.constants[PUBLISHED]
    return [*rows, *_constants(fitted, published)]


def compare_resolved(results: CurrentsResults) -> list[Comparison]:
    """Scales seen, noise, correlation and gain of every preset, water and strength."""
    band = results.band
    rows = [
        Comparison("longest vertical scale seen, by formula", "m", band.band[1]),
        Comparison("shortest vertical scale seen, by formula", "m", band.band[0]),
    ]
    for preset in PRESETS:
        low, high = results.seen[preset]
        rows += [
            Comparison(f"{preset}: longest vertical scale seen", "m", high, remark="half the largest gain"),
            Comparison(f"{preset}: shortest vertical scale seen", "m", low, remark="half the largest gain"),
        ]
    return [*rows, *(row for line in results.summary for row in _summary(line))]


def _inside(line: Row) -> Sequence[Comparison]:
    shares = [
        Comparison(
            f"{line['constants']}: inside {sigma} sigma", "1", line[f"inside_{sigma}"], share,
            remark=f"sampling error {line[f'inside_{sigma}_error']:.3f}; {line['twins']} twins; {line['verdict']}",
        )
        for sigma, share in COVERAGE.items()
    ]  # fmt: skip
    return [*shares, Comparison(f"{line['constants']}: mean area of the 1-sigma ellipse", "m2/s2", line["area"])]


def _constants(fitted: CurrentErrors, published: CurrentErrors) -> list[Comparison]:
    return [
        Comparison(f"fitted: {name.replace('_', ' ')}", _UNITS[name], getattr(fitted, name), getattr(published, name))
        for name in TERMS
    ]


def _summary(line: Row) -> list[Comparison]:
    what = f"{line['preset']}, {line['world']} x {line['factor']:g}"
    retrieved = Comparison(
        f"{what}: lateral current, rms", "m/s", line["lateral_rms"],
        remark=f"shear {line['shear_rms']:.2g} 1/s, forcing {line['forcing_rms']:.2g} m/s2 (rms)",
    )  # fmt: skip
    if line["world"] == STILL:
        return [retrieved]
    return [
        retrieved,
        Comparison(f"{what}: correlation with dU/dZ, dive", "1", line["correlation_shear_dive"]),
        Comparison(f"{what}: correlation with dU/dZ, climb", "1", line["correlation_shear_climb"]),
        Comparison(
            f"{what}: correlation with the forcing", "1", line["correlation_forcing"],
            remark=f"smoothed alike {line['correlation_alike']:.2f}",
        ),
        Comparison(
            f"{what}: gain on the forcing", "s", line["gain_forcing"], remark=f"smoothed alike {line['gain_alike']:.2g}"
        ),
    ]  # fmt: skip
