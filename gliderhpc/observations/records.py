"""Records of one profile in memory: SI units, radians, NaN where missing."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
TimeArray = npt.NDArray[np.datetime64]


@dataclass(frozen=True, eq=False)
class Fix:
    """One GPS fix at the surface.

    Attributes
    ----------
    time : numpy.datetime64
        Time of the position (ns, UTC).
    latitude, longitude : float
        Position (degree, WGS84).
    """

    time: np.datetime64
    latitude: float
    longitude: float


@dataclass(frozen=True, eq=False)
class ProfileRecord:
    """Records of one profile as measured; each variable has its own gaps.

    Attributes
    ----------
    number : int
        Number of the profile in its file.
    epoch : numpy.datetime64
        Time of the first sample (ns, UTC).
    time : (n,) array
        Seconds since `epoch`, strictly increasing.
    roll, pitch, heading : (n,) arrays
        Attitude (rad): starboard down, nose up, clockwise from true north. Heading is not unwrapped.
    depth : (n,) array
        Depth, positive down (m).
    battery_position : (n,) array
        Translation of the moving battery, forward positive (m).
    battery_rotation : (n,) array
        Rotation of the moving battery, gamma (rad).
    ballast_volume : (n,) array
        Oil in the external bladder (m3).
    rudder : (n,) array
        Rudder angle (rad), zero if the glider has none.
    entry_fix, exit_fix : Fix or None
        Last fix before the dive and first fix after it.
    surface_fixes_before, surface_fixes_after : tuple of Fix
        All fixes of the surface intervals on either side, in time order.
    notes : tuple of str
        Remarks on this record for readers of the result.
    temperature, practical_salinity, pressure : (n,) arrays or None
        Properties of the water (degC, 1, dbar); None if the file does not have them.
    velocity, velocity_std : (n, 3) arrays or None
        Measured velocity relative to the water in the body frame (forward, starboard, downward) and its standard
        deviation, m/s; None if the file does not have them.
    """

    number: int
    epoch: np.datetime64
    time: FloatArray
    roll: FloatArray
    pitch: FloatArray
    heading: FloatArray
    depth: FloatArray
    battery_position: FloatArray
    battery_rotation: FloatArray
    ballast_volume: FloatArray
    rudder: FloatArray
    entry_fix: Fix | None = None
    exit_fix: Fix | None = None
    surface_fixes_before: tuple[Fix, ...] = field(default=())
    surface_fixes_after: tuple[Fix, ...] = field(default=())
    notes: tuple[str, ...] = field(default=())
    temperature: FloatArray | None = None
    practical_salinity: FloatArray | None = None
    pressure: FloatArray | None = None
    velocity: FloatArray | None = None
    velocity_std: FloatArray | None = None

    @property
    def instants(self) -> TimeArray:
        """Times of the samples ``(n,)`` (UTC), exact to the nanosecond."""
        return np.asarray(self.epoch + np.rint(self.time * 1e9).astype("timedelta64[ns]"))
