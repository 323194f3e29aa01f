"""Columns of a profile's fixes and currents, as archives and the light currents store them."""

from typing import Any

import numpy as np

from gliderhpc.estimation.currents import DepthAveragedCurrent, mean_surface_drift
from gliderhpc.observations.records import Fix, ProfileRecord

Row = dict[str, Any]


def fix_row(end: str, fix: Fix) -> Row:
    """Return the time and the place of the fix at one end of a profile, ``entry`` or ``exit``."""
    return {f"{end}_time": fix.time, f"{end}_latitude": fix.latitude, f"{end}_longitude": fix.longitude}


def component_row(current: DepthAveragedCurrent, name: str) -> Row:
    """Return the components of a current; `name` is the columns' name with ``{}`` for the direction."""
    north, east = current.velocity.tolist()
    return {name.format("north"): north, name.format("east"): east}


def current_row(current: DepthAveragedCurrent, name: str, covariance: str) -> Row:
    """Return a current with its standard deviations and its covariance."""
    north, east = np.sqrt(np.diag(current.covariance)).tolist()
    deviations = {f"{name.format('north')}_std": north, f"{name.format('east')}_std": east}
    return component_row(current, name) | deviations | {covariance: float(current.covariance[0, 1])}


def surface_drift_row(record: ProfileRecord) -> Row:
    """Return the mean drift at the surface around a profile; empty if it is not known."""
    drift = mean_surface_drift(record)
    return {} if drift is None else {"surface_drift_north": float(drift[0]), "surface_drift_east": float(drift[1])}
