"""Whether a mission's records resolve the band in which turbulence is looked for, judged once before a study runs."""

import numpy as np
import xarray as xr

from gliderhpc.archive.opening import open_for_reading
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.studies.archived import chosen_profiles, platform_of, sample_interval
from gliderhpc.studies.library.turbulence.channel import series_step
from gliderhpc.studies.library.turbulence.settings import FastSettings
from gliderhpc.studies.library.turbulence.statistics import unresolved_text
from gliderhpc.studies.study import Request

EXAMINED = 5
"""Profiles, spread over those chosen, whose sample interval is looked at."""


def missing_band(request: Request, settings: FastSettings) -> str | None:
    """Say why the profiles of a request resolve nothing of the band, None where at least one of those examined does.

    Parameters
    ----------
    request : Request
        Archive, profiles and estimate.
    settings : FastSettings
        The study's, with the band in Hz.

    Raises
    ------
    InputError
        No such profile is done, or the archive has no such estimate.
    """
    with open_for_reading(request.archive) as archive:
        interval = _shortest_interval(archive, request)
        nyquist = 0.5 / max(interval, series_step(archive, request.estimate))
    lowest = settings.band[0]
    if nyquist > lowest:
        return None
    needed = f"this study needs samples less than {0.5 / lowest:.2g} s apart"
    return f"{unresolved_text(interval, nyquist, lowest)}; {needed}"


def _shortest_interval(archive: xr.DataTree, request: Request) -> float:
    """Sample interval (s) of the profile that is sampled most often, of a few spread over those chosen."""
    numbers = chosen_profiles(archive, request.profiles, request.quick)
    places = np.unique(np.linspace(0, len(numbers) - 1, EXAMINED).round().astype(np.int64))
    platform = platform_of(archive)
    return min(
        sample_interval(read_profile_data(archive, numbers[place], request.estimate), platform)
        for place in places.tolist()
    )
