"""What of the water's current across the hull is retrieved, by vertical scale: gain, phase and coherence."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from gliderhpc.errors import InputError
from gliderhpc.twins.currents.resolved import SCALES, SEGMENT
from gliderhpc.twins.runs import Row

LEAST_TERMS = 20
"""Terms of a spectral sum below which its line is left out: their coherence would be chance."""

MEDIANS = (
    "lateral_rms", "forcing_rms", "shear_rms", "depth_rate", "correlation_current", "correlation_shear_dive",
    "correlation_shear_climb", "correlation_forcing", "gain_forcing", "correlation_alike", "gain_alike",
)  # fmt: skip
GROUP = ["preset", "world", "factor"]


def summary_lines(rows: Sequence[Row]) -> list[Row]:
    """Medians over the twins of each preset, water and strength, in the order of the runs."""
    frame = pd.DataFrame([{name: value for name, value in row.items() if name != "spectra"} for row in rows])
    lines = []
    labels: Any
    for labels, group in frame.groupby(GROUP, sort=False):
        medians = {name: float(group[name].median()) for name in MEDIANS}
        lines.append({**dict(zip(GROUP, labels, strict=True)), "twins": len(group), **medians})
    return lines


def transfer_lines(rows: Sequence[Row]) -> list[Row]:
    """Transfer functions, one line a preset, water, strength and bin of vertical scale."""
    sums: dict[tuple[Any, ...], Any] = {}
    for row in rows:
        key = tuple(row[name] for name in GROUP)
        sums[key] = sums.get(key, 0.0) + np.array(row["spectra"])
    return [{**dict(zip(GROUP, key, strict=True)), **line} for key, total in sums.items() for line in _by_scale(total)]


def seen_band(lines: Sequence[Row]) -> tuple[float, float]:
    """Vertical scales (m) around the largest gain on the current over which at least half of it is left.

    Raises
    ------
    InputError
        No line: no stretch of steady glide was as long as a segment.
    """
    if not lines:
        raise InputError(
            f"no twin of a preset in broadband water glides steadily for {SEGMENT:g} s on end; give deeper twins"
        )
    gains = np.array([line["gain_current"] for line in lines])
    best = int(np.argmax(gains))
    short = np.flatnonzero(gains < 0.5 * gains.max())
    first = max((int(i) + 1 for i in short if i < best), default=0)
    last = min((int(i) - 1 for i in short if i > best), default=len(lines) - 1)
    return float(lines[first]["scale_low"]), float(lines[last]["scale_high"])


def _by_scale(sums: Any) -> list[Row]:
    lines = []
    for low, high, (terms, water, rate, retrieved, real, imaginary) in zip(
        SCALES[:-1], SCALES[1:], sums.T, strict=True
    ):
        # The spectrum of still water is rounding.
        if terms < LEAST_TERMS or water <= 1e-12 * retrieved:
            continue
        cross = complex(real, imaginary)
        lines.append(
            {
                "scale": float(np.sqrt(low * high)),
                "scale_low": float(low),
                "scale_high": float(high),
                "terms": int(terms),
                "gain_current": float(abs(cross) / np.sqrt(rate * water)),
                "gain_rate": float(abs(cross) / rate),
                "phase": float(np.degrees(np.angle(cross))),
                "coherence": float(abs(cross) ** 2 / (rate * retrieved)),
            }
        )
    return lines
