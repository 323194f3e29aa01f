"""Latitude and longitude of a profile's records, as far as its fixes allow."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.observations import Fix
from gliderhpc.observations.geodesic import moved
from gliderhpc.platform import Platform
from gliderhpc.report.og1.vocabulary import POSITION_METHODS
from gliderhpc.studies.library.anchored_track import anchored_tracks, fix_of, track_of
from gliderhpc.studies.library.profile_reconstruction import Motions, motions_of

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GroundTrack:
    """Where a profile's m records lie.

    Attributes
    ----------
    latitude, longitude : (m,) arrays
        Degrees, NaN where no fix says.
    method : int
        Of `POSITION_METHODS`.
    """

    latitude: Array
    longitude: Array
    method: int


def ground_track(archive: xr.DataTree, data: ProfileData, platform: Platform) -> GroundTrack:
    """Place a profile's records on the Earth.

    Between two fixes the track closes on both, each cycle's current included (`anchored_tracks`). With one fix alone
    the motion through the water is laid on to it and the current is left out; without any there is no position.
    """
    entry, last = fix_of(data.table, "entry"), fix_of(data.table, "exit")
    if entry is not None:
        return _from_entry(entry, archive, data, motions_of(data, platform))
    if last is not None:
        through_water = track_of(motions_of(data, platform).estimate)
        return _placed(last, through_water - through_water[-1], "to_the_fix_after")
    nowhere = np.full(len(data.record_time), np.nan)
    return GroundTrack(nowhere, nowhere, POSITION_METHODS["none"])


def _from_entry(entry: Fix, archive: xr.DataTree, data: ProfileData, motions: Motions) -> GroundTrack:
    tracks = anchored_tracks(archive, data, motions.estimate, motions.glide_angle)
    if tracks is None:
        return _placed(entry, track_of(motions.estimate), "from_the_fix_before")
    return _placed(entry, tracks.estimate, "between_both_fixes")


def _placed(origin: Fix, displacement: Array, method: str) -> GroundTrack:
    start = (origin.latitude, origin.longitude)
    places = np.array([moved(start, step) for step in displacement])
    return GroundTrack(places[:, 0], places[:, 1], POSITION_METHODS[method])
