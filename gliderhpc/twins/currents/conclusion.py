"""What the study concludes, in sentences made of its figures."""

from collections.abc import Sequence

from gliderhpc.studies.currents.passband import HALF
from gliderhpc.studies.library.current_difference import COVERAGE
from gliderhpc.twins.currents.coverage import ALL, OVER
from gliderhpc.twins.currents.results import FITTED, PUBLISHED, RESOLVING, CurrentsResults, strongest
from gliderhpc.twins.currents.runs import PRESETS, SHEAR, WORLDS
from gliderhpc.twins.runs import Row

_SHOWS = 0.1
"""Correlation beyond which something shows."""


def sentences(results: CurrentsResults) -> tuple[str, ...]:
    """Conclude on ellipses and on scales."""
    return (
        *(_coverage(line) for line in results.coverage if line["speed"] == ALL),
        _over_coverage(results),
        _offset(results),
        _limits(results),
        *(_measured(results, preset) for preset in PRESETS),
        _realistic(results),
    )


def line_of(coverage: Sequence[Row], constants: str, speed: str = ALL) -> Row:
    """Pick one line of coverage."""
    return next(line for line in coverage if line["constants"] == constants and line["speed"] == speed)


def _coverage(line: Row) -> str:
    shares = " and ".join(
        f"{line[f'inside_{sigma}']:.1%} within {sigma} sigma (asked {share:.0%}, sampling error "
        f"{line[f'inside_{sigma}_error']:.1%})"
        for sigma, share in COVERAGE.items()
    )
    return (
        f"Constants `{line['constants']}`: {shares} on {line['twins']} twins, mean area of the 1-sigma ellipse "
        f"{1e4 * line['area']:.2g} cm2/s2, so they {line['verdict'].replace('covers', 'cover')}."
    )


def _over_coverage(results: CurrentsResults) -> str:
    share = results.constants[PUBLISHED].relative_error
    wide = [
        line["speed"] for line in results.coverage
        if line["constants"] == PUBLISHED and line["speed"] != ALL and line["verdict"] == OVER
    ]  # fmt: skip
    where = f"at currents of {', '.join(wide)}" if wide else "at no speed"
    relative = "; ".join(f"{line['relative']:.0%} at {line['speed']}" for line in results.along)
    area = line_of(results.coverage, PUBLISHED)["area"] / line_of(results.coverage, FITTED)["area"]
    return (
        f"The published {share:.0%} with its companions over-covers {where}: the error along the current, over its "
        f"speed (both root mean square), is {relative}, for it does not grow with the current. The published ellipse "
        f"has {area:.2g} times the area of the fitted one."
    )


def _offset(results: CurrentsResults) -> str:
    along, across = results.bias
    lagless = results.lagless_bias[0]
    lag = "so the lag makes most of it" if abs(lagless) < 0.5 * abs(along) else "so it is not the lag that makes it"
    return (
        f"The errors have a mean of {along:+.4f} m/s along the track and {across:+.4f} m/s across it: the modelled "
        f"motion through the water is wrong by {results.motion_bias:+.4f} m/s along the track on average. With "
        f"actuators that do not lag their commands the mean along the track is {lagless:+.4f} m/s, {lag}. Ellipses "
        "about zero are never quite right at one and at two sigma at once when errors have a mean; the last set of "
        "constants says what is left without it."
    )


def _limits(results: CurrentsResults) -> str:
    band = results.band
    return (
        f"By formula, at {band.vertical_speed:.3g} m/s up or down, vertical scales longer than "
        f"{band.baseline_limit:.3g} m lose more than half to the moving average, those shorter than "
        f"{band.smoothing_limit:.3g} m to the smoothing; from {band.following_limit:.3g} m on the hull follows the "
        f"water more than it slips (time constant {band.following:.3g} s). All three leave at least {HALF:.0%} of "
        f"their largest response between {band.band[0]:.3g} and {band.band[1]:.3g} m."
    )


def _measured(results: CurrentsResults, preset: str) -> str:
    low, high = results.seen[preset]
    lines = strongest(results.transfer, preset)
    best = max(lines, key=lambda line: float(line["gain_current"]))
    inside = [line["coherence"] for line in lines if low <= line["scale"] <= high]
    return (
        f"Measured with preset {preset}: at least half of the largest gain between {low:.2g} and {high:.2g} m; the "
        f"largest, {best['gain_current']:.2g} of the current across the hull, at {best['scale']:.2g} m; coherence "
        f"there {min(inside):.2f} to {max(inside):.2f}; noise alone leaves {1e3 * results.noise[preset]:.2g} mm/s."
    )


def _realistic(results: CurrentsResults) -> str:
    line = next(
        line for line in results.summary
        if (line["preset"], line["world"], line["factor"]) == (RESOLVING, SHEAR, WORLDS[SHEAR][0][0])
    )  # fmt: skip
    known = abs(line["correlation_alike"]) > _SHOWS
    return (
        f"Of the shear of the scenario `paper` itself (rms {line['shear_rms']:.2g} 1/s) "
        f"{'a part' if known else 'nothing'} shows: correlation {line['correlation_alike']:+.2f} with what pushes the "
        f"hull, {1e3 * line['lateral_rms']:.2g} mm/s retrieved beside {1e3 * results.noise[RESOLVING]:.2g} mm/s by "
        "noise alone."
    )
