"""Calibration of a hull on a mission's own glides, and tuning of its disturbance prior."""

import logging
from typing import Any

from gliderhpc.api.arguments import (
    HullArgument,
    Profiles,
    assignments_of,
    platform_of,
    profiles_text,
    settings_of,
)
from gliderhpc.api.workers import executor_of
from gliderhpc.calibration.estimated_hulls import CalibratedHull, TunedHull
from gliderhpc.calibration.prior.fit import TuneSettings
from gliderhpc.calibration.settings import CalibrateSettings
from gliderhpc.calibration.workflow import CalibrationInputs, calibrate_and_tune, calibrate_open, tune_open
from gliderhpc.observations.in_memory import Records, opened_records

log = logging.getLogger("gliderhpc.calibrate")


def calibrate(
    records: Records,
    hull: HullArgument,
    *,
    profiles: Profiles = None,
    hold_out: Profiles = None,
    tune: bool = False,
    settings: CalibrateSettings | None = None,
    workers: int | None = None,
    **named: Any,
) -> CalibratedHull:
    """Fit the trim, drag and lateral terms that a mission's steady glides determine.

    With ``rounds={"most": 8}`` the hull and the errors of the records are estimated in rounds over whole dives. In each
    round all dives are smoothed with the present hull. The rounds start from the fitted trim. If they find a better
    hull, it replaces the fit.

    Parameters
    ----------
    records : xarray.Dataset, str or Path
        Observations.
    hull : Platform, str or Path
        The hull to start from.
    profiles : int, iterable of int, or str, optional
        Profiles to use; by default a selection spread over the mission.
    hold_out : int, iterable of int, or str, optional
        Profiles held out of the fit and used only for the score; by default every fourth.
    tune : bool
        Whether to tune the disturbance prior on the calibrated hull, and to calibrate again with that prior.
    settings : CalibrateSettings, optional
        Settings of the fit.
    workers : int, optional
        Number of worker processes, 0 to compute in this process; by default one per core.
    **named
        Settings by name, which override those of `settings`: ``calibration={"trend": True}``.

    Returns
    -------
    CalibratedHull
        The hull, with ``.platform``, ``.table``, ``.history``, ``.scores``, ``.notes``, ``.warnings`` and
        ``.save(path)``: a `HullFromDives` if there were rounds and they found a better hull, and otherwise a
        `HullFromGlides`.

    Raises
    ------
    InputError
        An argument cannot be used, or the profiles contain too little steady flight.
    CalibrationError
        No hull better than the starting one was found.
    """
    chosen, platform = settings_of(CalibrateSettings, settings, named), platform_of(hull)
    executor = executor_of(workers)
    calibration = calibrate_and_tune if tune else calibrate_open
    with opened_records(records) as observations:
        texts = profiles_text(profiles), profiles_text(hold_out)
        return calibration(CalibrationInputs(observations, platform, chosen, *texts, assignments_of(named)), executor)


def tune(
    records: Records,
    hull: HullArgument,
    *,
    profiles: Profiles = None,
    settings: TuneSettings | None = None,
    **named: Any,
) -> TunedHull:
    """Estimate the disturbance prior of filter and smoother that maximises the likelihood of the records.

    Parameters
    ----------
    records : xarray.Dataset, str or Path
        Observations.
    hull : Platform, str or Path
        The hull, whose prior is the starting point.
    profiles : int, iterable of int, or str, optional
        Profiles to tune on; by default a selection spread over the mission.
    settings : TuneSettings, optional
        Settings of the filter and of its tuning.
    **named
        Settings by name, which override those of `settings`: ``tuning={"longest": 1800.0}``.

    Returns
    -------
    TunedHull
        The hull, with ``.platform``, ``.table``, ``.notes``, ``.warnings`` and ``.save(path)``.

    Raises
    ------
    InputError
        An argument cannot be used, or no profile can be tuned on.
    """
    chosen, platform = settings_of(TuneSettings, settings, named), platform_of(hull)
    with opened_records(records) as observations:
        return tune_open(observations, platform, chosen, profiles_text(profiles), assignments_of(named), log.info)
