"""What the reader of these studies has to know: what the records resolve, and which profiles have nothing to say."""

import numpy as np
import pandas as pd

from gliderhpc.analysis.turbulence.settings import SpectraSettings


def about_the_band(table: pd.DataFrame, settings: SpectraSettings, step: float) -> tuple[str, ...]:
    """Say how far up the records resolve the band, and where the series itself ends within it."""
    low, high = settings.band
    nyquist = float(table["nyquist"].median())
    if nyquist >= high:
        return ()
    resolved = f"from {low:g} to {nyquist:.3g} Hz of it" if nyquist > low else "nothing of it"
    remark = f"the band reaches from {low:g} to {high:g} Hz; the records resolve {resolved}"
    if nyquist > low:
        remark += (
            ": what lies above is made by interpolation and windows, and the exponent on the band is theirs in part"
        )
    if 0.5 / step < high - 1e-9:
        remark += (
            f"; the series ends at {0.5 / step:g} Hz ({step:g} s apart), so no exponent is given on the whole band"
        )
    return (remark,)


def without_statistics(table: pd.DataFrame) -> tuple[dict[int, str], pd.DataFrame]:
    """Profiles without statistics with the reason, and the table of the others."""
    messages = table["message"] if "message" in table else pd.Series(np.nan, index=table.index)
    told = [isinstance(text, str) for text in messages]
    failed = {
        int(number): str(text) for number, text, tells in zip(table["profile"], messages, told, strict=True) if tells
    }
    return failed, table[[not tells for tells in told]]
