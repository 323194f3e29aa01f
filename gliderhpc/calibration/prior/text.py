"""Results of a tuning: tables, and provenance in the platform file."""

import math
from collections.abc import Sequence

from gliderhpc.calibration.glides.text import describe_origin
from gliderhpc.calibration.prior.fit import TunedPrior, TuneSettings, TuningVerdict
from gliderhpc.calibration.prior.likelihood import Whiteness
from gliderhpc.vocabulary import CHANNELS
from gliderhpc.wording import capitalised

INTERPOLATED = (
    "records slower than the filter's limit were interpolated before filtering, so their innovations are correlated "
    "by construction and never white; compare the currents with those of the untuned prior, which may be better on "
    "such records"
)
"""Remark on slow records."""

_SHOWN_LAGS = 3
_UNKNOWN = math.log(100.0)


def prior_rows(tuned: TunedPrior) -> list[tuple[str, ...]]:
    """Return the rows of the table of the prior: channel, quantity, unit, before, after, uncertainty, remark."""
    return [
        (channel, quantity, unit, f"{before:.4g}", f"{after:.4g}", factor_text(error), remark_of(verdict))
        for (channel, quantity, unit), before, after, error, verdict in zip(
            _NUMBERS, tuned.before.numbers, tuned.after.numbers, tuned.errors, tuned.verdicts, strict=True
        )
    ]


def whiteness_rows(tuned: TunedPrior) -> list[tuple[str, ...]]:
    """Return the whiteness rows: sensor, prior, count, mean, variance, first autocorrelations, portmanteau, p."""
    rows: list[tuple[str, ...]] = []
    for sensor in tuned.whiteness_before:
        for prior, whiteness in (("before", tuned.whiteness_before[sensor]), ("after", tuned.whiteness_after[sensor])):
            first = [_figure(value, "+.2f") for value in whiteness.autocorrelation[:_SHOWN_LAGS]]
            rows.append(
                (
                    sensor,
                    prior,
                    str(whiteness.count),
                    _figure(whiteness.mean, "+.3f"),
                    _figure(whiteness.variance, ".3f"),
                    " ".join(filter(None, first)),
                    _figure(whiteness.portmanteau, ".2f"),
                    _figure(whiteness.p, ".2g"),
                )
            )
    return rows


def _figure(value: float, form: str) -> str:
    """Format a value, empty where there were too few innovations for it."""
    return format(value, form) if math.isfinite(value) else ""


def provenance(
    tuned: TunedPrior,
    observations: str,
    digest: str,
    used: Sequence[int],
    settings: TuneSettings,
    assignments: Sequence[str],
) -> str:
    """Describe the tuning for the platform file: data, profiles, overrides, gain, prior and innovations."""
    origin = describe_origin("Prior tuned by `gliderhpc tune`", observations, digest, assignments)
    sentences = [
        f"{origin}, {used_text(used, settings)}",
        *map(capitalised, (closing_text(tuned, settings), *warnings(tuned, settings))),
        "; ".join(_number_text(row) for row in prior_rows(tuned)),
        "Normalised innovations before and after, variance (portmanteau over lags): "
        + ", ".join(
            f"{sensor} {_brief(tuned.whiteness_before[sensor])} and {_brief(tuned.whiteness_after[sensor])}"
            for sensor in tuned.whiteness_before
        ),
    ]
    if tuned.interpolated:
        sentences.append(capitalised(INTERPOLATED))
    return ". ".join(sentences) + "."


def used_text(used: Sequence[int], settings: TuneSettings) -> str:
    """Describe the profiles used, and the part of each."""
    numbers = ", ".join(map(str, used))
    return (
        f"profile{'s' if len(used) > 1 else ''} {numbers}, the first {settings.tuning.longest / 60.0:.0f} min of each"
    )


def closing_text(tuned: TunedPrior, settings: TuneSettings) -> str:
    """Describe the gain, the rejected samples, and whether the maximum was reached; warnings are separate."""
    before, after = tuned.evaluation_before, tuned.evaluation_after
    reached = "" if tuned.settled else "; the rounds ended before the maximum was reached, increase tuning.max_rounds"
    return (
        f"log-likelihood {before.log_likelihood:.1f} before, {after.log_likelihood:.1f} after, gain {tuned.gain:+.1f}; "
        f"largest share of a profile's samples rejected {max(before.rejected_fraction):.1%} before, "
        f"{max(after.rejected_fraction):.1%} after{reached}"
    )


def warnings(tuned: TunedPrior, settings: TuneSettings) -> list[str]:
    """Return a warning if a run with the tuned prior would refuse one of the profiles."""
    refused = refusal(tuned, settings)
    advice = "so do not use this prior: calibrate the hull first, or tune on rougher profiles"
    return [f"{refused}, {advice}"] if refused else []


def refusal(tuned: TunedPrior, settings: TuneSettings) -> str:
    """Return why a run with the tuned prior would refuse one of the profiles; empty if it would not."""
    limit, worst = settings.filter.max_rejected_fraction, max(tuned.evaluation_after.rejected_fraction)
    if worst <= limit:
        return ""
    return f"a run refuses a profile with more than {limit:.0%} of its samples rejected, and one would have {worst:.0%}"


def factor_text(error: float) -> str:
    """Format the standard error of a logarithm as a factor."""
    if math.isnan(error):
        return ""
    return f"{math.exp(error):.2f}" if error < _UNKNOWN else f"> {math.exp(_UNKNOWN):.0f}"


def remark_of(verdict: TuningVerdict) -> str:
    """Return the remark on a number, empty if it was estimated."""
    return "" if verdict is TuningVerdict.ESTIMATED else verdict.value


_NUMBERS = [
    *((channel, "deviation", unit) for channel, (unit, *_) in CHANNELS.items()),
    *((channel, "correlation time", "s") for channel in CHANNELS),
]


def _number_text(row: tuple[str, ...]) -> str:
    channel, quantity, unit, before, after, factor, remark = row
    notes = ", ".join(filter(None, [factor and f"to a factor {factor}", remark]))
    return f"{channel} {quantity} {before} to {after} {unit}" + (f" ({notes})" if notes else "")


def _brief(whiteness: Whiteness) -> str:
    return f"{whiteness.variance:.2f} ({whiteness.portmanteau:.1f})"
