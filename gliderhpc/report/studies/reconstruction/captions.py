"""What the reconstruction's tables and figures are made from, and how sure they are."""

import pandas as pd

from gliderhpc.estimation.open_loop import SEGMENT
from gliderhpc.findings.tables import number
from gliderhpc.report.captions import data_said, estimate_said, profiles_said
from gliderhpc.studies.provenance import Provenance

_NO_ERROR = (
    "Residuals measure how closely the records are followed, not how true the disturbance is: what the estimate puts "
    "into a disturbance cannot show as a residual."
)


def captions(
    made: Provenance, table: pd.DataFrame, channels: pd.DataFrame, impulses: pd.DataFrame, drawn: list[int]
) -> dict[str, str]:
    """Captions by stem; `drawn` are the profiles of Figure 3."""
    estimate = estimate_said(made)
    own = {
        "profiles": _of_profiles(made, table),
        "figure_2": (
            f"Profile {made.profiles[0]}: measured attitude and depth beside the motion that {estimate} reconstructs, "
            "and both tracks closed on the GPS fixes. Grey: actuators moving, left out of the residuals named. "
            f"{_NO_ERROR}"
        ),
        "figure_3": (
            f"Yaw moment by {estimate} and by the filter, with heading and battery rotation: {profiles_said(drawn)}. "
            f"{_lag_said(made, table)} Neither carries an error here; with the battery rotated (blue) errors of the "
            "hull's model show in both."
        ),
    }
    truth = f"{data_said(made)} of a synthetic mission whose truth is known"
    if not channels.empty:
        own["recovery"] = (
            f"Lag and gain of every disturbance by {estimate} and by the filter, and delay and height of "
            f"{len(impulses)} yaw impulses, against the truth: {truth}. The truth shares the "
            "estimator's equations, so an error of the model itself is not in it."
        )
    return own | {
        "channels": f"Lag, correlation and gain against the truth, a row a profile, channel and estimator: {truth}.",
        "impulses": (
            f"Every true yaw impulse that stands alone in steady glide, and delay and height of the peak that "
            f"{estimate} and the filter show within seconds of it: {len(impulses)} impulses in {truth}."
        ),
    }


def _lag_said(made: Provenance, table: pd.DataFrame) -> str:
    known = table.loc[table["yaw_lag"].notna(), ["profile", "yaw_lag"]]
    if known.empty:
        return "No lag of the filter behind it could be told."
    lag = number(float(known["yaw_lag"].median()))
    return f"The filter is {lag} s behind (median of {data_said(made, known['profile'].tolist())})."


def _of_profiles(made: Provenance, table: pd.DataFrame) -> str:
    flown = int(table["segment_start"].notna().sum()) if "segment_start" in table else 0
    second = int(table["no_slope_steady_roll"].notna().sum()) if "no_slope_steady_roll" in table else 0
    return (
        f"A row a profile: {data_said(made)}, estimate of {estimate_said(made)}. Root mean square residuals over "
        f"steady glide and over the vibration intervals; {flown} flown open loop for {SEGMENT:g} s, {second} inverted "
        f"anew with k_z = 0. {_NO_ERROR}"
    )
