"""What a synthetic mission's truth tells of the estimators, as the group keeps it and as tables show it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData, truth_on_samples
from gliderhpc.studies.reconstruction.estimator_comparison import YAW, impulse_rows, truth_rows
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]
Row = Mapping[str, Any]

PRIOR = "prior"
TRUE_YAW = "B_cr_truth"
"""Variable that holds the true yaw moment."""

_BY_CHANNEL = ("lag", "correlation", "gain")
_OF_IMPULSE, _AS_SEEN = ("time", "amplitude", "width"), ("delay", "ratio")
_GROUP = "reconstruction"


def estimators(estimate: str) -> tuple[str, str]:
    """Names along the group's dimension of estimators."""
    return estimate, PRIOR


def truth_columns(data: ProfileData, truth: xr.Dataset, impulses: int) -> Row:
    """Hold both estimators of a profile against its truth: values by channel, and by impulse up to so many."""
    own = estimators(data.estimate)
    by_channel = {name: np.full((len(CHANNELS), len(own)), np.nan) for name in _BY_CHANNEL}
    for row in truth_rows(data, truth):
        place = list(CHANNELS).index(row["channel"]), own.index(row["estimator"])
        for name in _BY_CHANNEL:
            by_channel[name][place] = row[name]
    alone = impulse_rows(data, truth)
    of_impulse = {name: _padded([row[name] for row in alone], impulses) for name in _OF_IMPULSE}
    as_seen = {
        name: np.column_stack([_padded([row[f"{one}_{name}"] for row in alone], impulses) for one in own])
        for name in _AS_SEEN
    }
    return {f"truth_{name}": values for name, values in by_channel.items()} | {
        f"impulse_{name}": values for name, values in (of_impulse | as_seen).items()
    }


def true_yaw(data: ProfileData, truth: xr.Dataset) -> Array:
    """True yaw moment ``(n,)`` on the samples, N m."""
    return truth_on_samples(data, truth)[:, YAW]


def kept_yaw(archive: xr.DataTree, data: ProfileData) -> Array | None:
    """True yaw moment ``(n,)`` on a profile's samples as the group keeps it; None where no truth was given."""
    values: Array = archive[_GROUP].to_dataset()[TRUE_YAW].sel(profile=data.number).values[: len(data.time)]
    return values if np.isfinite(values).any() else None


def channel_table(archive: xr.DataTree, numbers: list[int]) -> pd.DataFrame:
    """Lag, correlation and gain against the truth, a row a profile, channel and estimator that has them."""
    group = archive[_GROUP].to_dataset().sel(profile=numbers)
    values = {name: group[f"truth_{name}"].values for name in _BY_CHANNEL}
    places = np.argwhere(np.isfinite(values["gain"])).tolist()
    channels, own = group["channel"].values, group["estimator"].values
    return pd.DataFrame(
        [
            {"profile": numbers[profile], "channel": str(channels[channel]), "estimator": str(own[estimator])}
            | {name: float(column[profile, channel, estimator]) for name, column in values.items()}
            for profile, channel, estimator in places
        ]
    )


def impulse_table(archive: xr.DataTree, numbers: list[int]) -> pd.DataFrame:
    """True yaw impulses that stand alone in steady glide, and how either estimator shows them, a row an impulse."""
    group = archive[_GROUP].to_dataset().sel(profile=numbers)
    columns = {name: group[f"impulse_{name}"].values for name in _OF_IMPULSE}
    columns |= {
        f"{own}_{name}": group[f"impulse_{name}"].values[:, :, place]
        for place, own in enumerate(map(str, group["estimator"].values))
        for name in _AS_SEEN
    }
    known = np.isfinite(columns["time"])
    which = np.repeat(numbers, known.sum(axis=1))
    return pd.DataFrame({"profile": which} | {name: values[known] for name, values in columns.items()})


def _padded(values: list[float], length: int) -> Array:
    return np.array(values + [np.nan] * (length - len(values)), dtype=np.float64)
