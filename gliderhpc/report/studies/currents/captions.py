"""What the study's table and figures are made from, and what they do not resolve."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from gliderhpc.findings.tables import number
from gliderhpc.report.captions import data_said, estimate_said
from gliderhpc.studies.currents.settings import DepthResolvedSettings
from gliderhpc.studies.library.current_difference import COVERAGE
from gliderhpc.studies.provenance import Provenance


def captions(
    made: Provenance, table: pd.DataFrame, settings: DepthResolvedSettings, drawn: Mapping[str, int]
) -> dict[str, str]:
    """Captions by stem, of the table and of the figures, which have the profile that each draws."""
    figures = {
        stem: _of_figure(made, table[table["profile"] == profile].iloc[0], settings) for stem, profile in drawn.items()
    }
    return {"currents": _of_table(made, table)} | figures


def _of_table(made: Provenance, table: pd.DataFrame) -> str:
    known = int(table["current_north"].notna().sum())
    text = (
        f"Depth-averaged current from the fixes and the self-motion of {estimate_said(made)}, with every term of its "
        f"uncertainty, and a summary of the depth-resolved current: {data_said(made)}, {known} of them with a current. "
    )
    if "ellipse_major" not in table:
        return text + "Without fixes on either side there is no ellipse."
    major, minor = (number(float(table[f"ellipse_{axis}"].median())) for axis in ("major", "minor"))
    return (
        f"{text}Ellipses are of one sigma and hold {COVERAGE[1]:.0%} of normal errors; median semi-axes {major} and "
        f"{minor} m/s. They hold the errors believed of axial speed, compass, fixes and actuation, not one that all "
        "profiles share unnoticed."
    )


def _of_figure(made: Provenance, row: pd.Series, settings: DepthResolvedSettings) -> str:
    noise = bool(np.isfinite(row["significant_fraction"]))
    hull = f"moment coefficients off by up to {settings.coefficient_error:.0%} ({settings.draws} draws)"
    known = f"{hull} and the noise of the yaw moment" if noise else f"{hull}; the yaw moment's noise is not known"
    share = number(float(row["coefficient_share"]))
    return (
        f"Profile {int(row['profile'])}: current by depth by eq. 41, from the yaw moment of {estimate_said(made)} less "
        f"its moving average of {settings.baseline:g} s, smoothed over {settings.smoothing:g} s, in bins of "
        f"{settings.bin:g} m, over the depth-averaged current (dashed). Bands are two sigma by {known}; the "
        f"coefficients alone scatter the lateral current by {share} of itself. It is a lower bound: the hull follows "
        "slow changes of the current, and the vertical scales named below the panels do not show."
    )
