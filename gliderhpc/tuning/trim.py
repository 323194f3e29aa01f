"""A hull's buoyancy, drag and trim in pitch from its steady glides: where the rounds over the dives start."""

from collections.abc import Callable

import numpy as np

from gliderhpc.flight.hull_parameters import hull_parameters
from gliderhpc.platform import Platform
from gliderhpc.tuning.calibration import CalibrationSettings, check_profiles, explored, is_stable, keys_of
from gliderhpc.tuning.calibration_search import RESCALINGS, USUAL, CalibrationSearch, best_start
from gliderhpc.tuning.segment_errors import SegmentErrors, steady_parameters
from gliderhpc.tuning.steady_segments import SteadySegments

TRIM = (
    "buoyancy.neutral_volume", "buoyancy.depth_slope", "buoyancy.compressibility", "viscous.K_D0", "position.hull.2",
    "position.battery",
)  # fmt: skip
"""Buoyancy, drag and trim in pitch, which decide whether a hull follows its records at all."""


def fit_trim(
    platform: Platform, segments: SteadySegments, settings: CalibrationSettings,
    report: Callable[[str], None] = lambda _: None,
) -> Platform:  # fmt: skip
    """Fit the buoyancy, the drag and the trim in pitch to the steady glides, with plausible deviations as a prior.

    This is where the rounds over the dives start. With these few numbers near the truth the filter follows the records.
    The others, lift and lateral terms above all, are left as they are: in steady flight an offset of the pitch or the
    roll acts as they do, and a fit without these offsets leads them far off.

    Parameters
    ----------
    platform : Platform
        The hull to start from.
    segments : SteadySegments
        To fit.
    settings : CalibrationSettings
        How; what it holds stays as it is.
    report : callable
        Called with a line on every step.

    Returns
    -------
    Platform
        The hull fitted; the one given where that has no stable glide.

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
    search.steps = best_start(explored(errors), free, report)
    search.fit_everything(RESCALINGS, USUAL)
    return errors.hull(search.steps) if is_stable(errors, search) else platform
