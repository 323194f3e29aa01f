"""What the study of vertical velocities says of a mission: its table, and what to mind."""

import numpy as np
import pandas as pd

from gliderhpc.findings.comparison import Comparison
from gliderhpc.studies.library.depth_rate import half_power
from gliderhpc.studies.vertical.velocity import HullErrors

WANTED = 0.005
"""Standard deviation of a vertical velocity that users ask for, m/s."""

_DOUBTFUL = 2.0


def comparisons(table: pd.DataFrame, errors: HullErrors) -> tuple[Comparison, ...]:
    """Figures over the profiles, medians where nothing else is said.

    Parameters
    ----------
    table : pandas.DataFrame
        A row a profile, as the study writes it.
    errors : HullErrors
        Of the hull's numbers, and where they come from.
    """
    whose = "errors of the calibration" if errors.calibrated else "plausible deviations, not calibrated"
    window = _median(table, "window")
    return (
        Comparison("samples with a vertical velocity, part of all", "1", _median(table, "share")),
        Comparison("window of the filter", "s", window, remark=f"half power at {1e3 * half_power() / window:.1f} mHz"),
        *(_of_leg(table, leg, whose) for leg in ("dive", "climb")),
        Comparison("root mean square of the water's vertical velocity", "m/s", _root(table, "mean_square")),
        Comparison("its standard deviation by the depth sensor's noise", "m/s", _median(table, "noise_std")),
        *_differences(table, whose),
        *(
            _of_number(table, suspect.key.rpartition(".")[2], leg)
            for suspect in errors.suspects
            for leg in ("dive", "climb")
        ),
        *_against_truth(table),
    )


def remarks_on(table: pd.DataFrame, errors: HullErrors) -> tuple[str, ...]:
    """Say where the hull's numbers and not the water may be seen."""
    remarks = []
    if not errors.calibrated:
        remarks.append(
            "the platform carries no calibration's errors, so each number of the hull counts with its plausible "
            "deviation: calibrate it (gliderhpc calibrate) and run the mission with the file that it writes"
        )
    mean, error = _mean_difference(table)
    expected = _median(table, "difference_std")
    if abs(mean) > _DOUBTFUL * np.hypot(error, expected):
        remarks.append(
            f"dives and climbs differ by {100 * mean:+.2f} cm/s, more than errors of {100 * error:.2f} (scatter) and "
            f"{100 * expected:.2f} cm/s (hull) explain: the hull's numbers are off, or the pitch sensor is"
        )
    return tuple(remarks)


def _of_leg(table: pd.DataFrame, leg: str, whose: str) -> Comparison:
    deviation = _median(table, f"mean_std_{leg}")
    return Comparison(
        f"mean vertical velocity of the water, {leg}s", "m/s", _median(table, f"mean_{leg}"),
        spread=_quartiles(table, f"mean_{leg}"), remark=f"standard deviation {deviation:.4f} m/s by {whose}",
    )  # fmt: skip


def _differences(table: pd.DataFrame, whose: str) -> tuple[Comparison, ...]:
    if "difference" not in table:
        return ()
    mean, error = _mean_difference(table)
    return (
        Comparison("dives less climbs at the same depths, mean", "m/s", mean,
                   remark=f"{error:.4f} m/s by the scatter of {table['difference'].notna().sum()} profiles"),
        Comparison("its standard deviation as expected", "m/s", _median(table, "difference_std"),
                   remark=f"by {whose}; users ask for {WANTED:g}"),
        Comparison("dives less climbs, root mean square over levels", "m/s", _median(table, "difference_rms")),
    )  # fmt: skip


def _of_number(table: pd.DataFrame, name: str, leg: str) -> Comparison:
    return Comparison(
        f"change by a plausible one of {name}, {leg}s", "m/s", _median(table, f"by_{name}_{leg}"),
        spread=_quartiles(table, f"by_{name}_{leg}"),
    )  # fmt: skip


def _against_truth(table: pd.DataFrame) -> tuple[Comparison, ...]:
    if "error_rms" not in table:
        return ()
    return (
        Comparison("against the truth, root mean square", "m/s", _median(table, "error_rms")),
        Comparison("against the truth, mean", "m/s", _median(table, "error_mean")),
        Comparison("error over its stated deviation, root mean square", "1", _median(table, "error_normalised")),
        Comparison("correlation with the truth", "1", _median(table, "truth_correlation")),
    )


def _mean_difference(table: pd.DataFrame) -> tuple[float, float]:
    """Mean over the profiles of dives less climbs, and its standard error by their scatter (NaN of one profile)."""
    if "difference" not in table:
        return float("nan"), float("nan")
    values = table["difference"].dropna().to_numpy()
    error = float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else float("nan")
    return (float(values.mean()) if len(values) else float("nan")), error


def _median(table: pd.DataFrame, name: str) -> float:
    return float(table[name].median()) if name in table else float("nan")


def _root(table: pd.DataFrame, name: str) -> float:
    return float(np.sqrt(table[name].mean()))


def _quartiles(table: pd.DataFrame, name: str) -> tuple[float, float] | None:
    if name not in table:
        return None
    low, high = table[name].quantile([0.25, 0.75]).tolist()
    return float(low), float(high)
