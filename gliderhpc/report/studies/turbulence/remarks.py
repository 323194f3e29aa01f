"""What the reader of these studies has to know: how far up the records resolve the band."""

import pandas as pd

from gliderhpc.studies.library.turbulence.settings import SpectraSettings


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
