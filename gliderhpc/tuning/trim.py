"""A hull's buoyancy, drag and trim in pitch from its steady glides: the start of the rounds over the dives."""

from collections.abc import Callable

import numpy as np

from gliderhpc.flight.hull_parameters import hull_parameters
from gliderhpc.platform import Platform
from gliderhpc.tuning.calibration import CalibrationSettings, check_profiles, is_stable, start_subset
from gliderhpc.tuning.calibration_search import DEFAULT_TOLERANCE, RESCALINGS, CalibrationSearch, best_start
from gliderhpc.tuning.segment_errors import SegmentErrors, keys_of, steady_parameters
from gliderhpc.tuning.steady_segments import SteadySegments

TRIM = (
    "buoyancy.neutral_volume", "buoyancy.depth_slope", "buoyancy.compressibility", "viscous.K_D0", "position.hull.2",
    "position.battery",
)  # fmt: skip
"""Buoyancy, drag and trim in pitch, which decide whether the filter can follow the records at all."""


def fit_trim(
    platform: Platform,
    segments: SteadySegments,
    settings: CalibrationSettings,
    report: Callable[[str], None] = lambda _: None,
) -> Platform:
    """Fit the buoyancy, the drag and the trim in pitch to the steady glides, with plausible deviations as a prior.

    The result is the start of the rounds over the dives. With these few numbers near the truth the filter follows the
    records. The other numbers, mainly lift and lateral terms, are left unchanged: in steady flight an offset of the
    pitch or the roll acts like them, and a fit without these offsets would move them far from the truth.

    Parameters
    ----------
    platform : Platform
        The hull to start from.
    segments : SteadySegments
        Segments to fit.
    settings : CalibrationSettings
        Settings of the calibration; parameters that they hold stay unchanged.
    report : callable
        Called with a line of text at every step.

    Returns
    -------
    Platform
        Fitted hull; the hull given if the fitted one has no stable glide.

    Raises
    ------
    InputError
        Fewer profiles than `MIN_PROFILES`.
    """
    check_profiles(segments)
    candidates = steady_parameters(platform, segments)
    keys = [p.key for p in candidates]
    free = np.isin(keys, TRIM) & ~np.isin(keys, keys_of(settings.hold, (*candidates, *hull_parameters(platform))))
    errors = SegmentErrors(platform, candidates, segments)
    search = CalibrationSearch(errors, free, settings.undetermined, report)
    search.steps = best_start(start_subset(errors), free, report)
    search.fit_everything(RESCALINGS, DEFAULT_TOLERANCE)
    return errors.hull(search.steps) if is_stable(errors, search) else platform
