"""Band that a mission's records resolve, before a study of turbulence starts."""

from collections.abc import Iterator

import numpy as np

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.archive.reader import Archive
from gliderhpc.observations.profile_numbers import evenly_spaced
from gliderhpc.studies.archived import chosen_profiles, platform_of, sample_interval
from gliderhpc.studies.library.turbulence.series import FastSettings, describe_unresolved, series_step
from gliderhpc.studies.request import Request

EXAMINED_PROFILES = 5
"""Number of profiles, spread over those chosen, whose sample interval is compared with the band."""


def missing_band(request: Request, settings: FastSettings) -> str | None:
    """Return the reason why no examined profile of a request resolves any of the band, or None if at least one does.

    Parameters
    ----------
    request : Request
        Archive, profiles and estimate.
    settings : FastSettings
        Settings of the study, with the band in Hz.

    Raises
    ------
    InputError
        No such profile is done, or the archive has no such estimate.
    """
    lowest, interval, nyquist = settings.band[0], np.inf, 0.0
    with open_for_reading(request.archive) as archive:
        step = series_step(archive, request.estimate)
        for own in _sample_intervals(archive, request):
            interval = min(interval, own)
            nyquist = 0.5 / max(interval, step)
            if nyquist > lowest:
                return None
    needed = f"this study needs samples less than {0.5 / lowest:.2g} s apart"
    return f"{describe_unresolved(interval, nyquist, lowest)}; {needed}"


def _sample_intervals(archive: Archive, request: Request) -> Iterator[float]:
    """Yield the sample intervals (s) of a few profiles spread over those chosen."""
    numbers = chosen_profiles(archive, request.profiles, request.quick)
    platform = platform_of(archive)
    for number in evenly_spaced(numbers, EXAMINED_PROFILES):
        yield sample_interval(read_profile_data(archive, number, request.estimate), platform)
