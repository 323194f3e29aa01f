"""Glides in a current by the steady balance of forces, made without the package's own flight model."""

from dataclasses import dataclass

import numpy as np
import scipy
import xarray as xr
from geographiclib.geodesic import Geodesic

START = np.datetime64("2024-05-01T00:00:00", "ns")
DRAG, INDUCED, LIFT = 7.7, 538.0, 386.0
"""Of the shipped slocum, kg/m, kg/m/rad2, kg/m/rad."""


@dataclass(frozen=True)
class Glide:
    """Parameters of a mission of glides."""

    dives: int = 3
    depth: float = 400.0
    pitch: float = 26.0
    interval: float = 4.0
    current: tuple[float, float] = (0.12, -0.07)
    drag: float = 1.0
    pitch_offset: float = 0.0
    heading_offset: float = 0.0
    fix_error: float = 0.0
    net_buoyancy: float = 2.5
    park: float = 0.0
    seed: int = 0


def angle_of_attack(pitch, drag=1.0):
    """Steady angle of attack (rad) of a dive at a pitch (rad, negative), by root finding."""

    def unbalanced(alpha):
        return drag * (DRAG + INDUCED * alpha**2) + LIFT * alpha * np.tan(pitch - alpha)

    return scipy.optimize.brentq(
        unbalanced, 0.0, scipy.optimize.minimize_scalar(unbalanced, bounds=(0.0, 0.3), method="bounded").x
    )


def mission(glide: Glide) -> xr.Dataset:
    """Records of a mission by the names of the observation format, without ballast and battery.

    Headings turn by 100 degrees from dive to dive; every dive is followed by five minutes adrift. A glider that parks
    at the deepest point lies level, and is still in the water for `Glide.park` seconds.
    """
    rng = np.random.default_rng(glide.seed)
    pitch = -np.radians(glide.pitch)
    alpha = angle_of_attack(pitch, glide.drag)
    path = pitch - alpha
    speed = np.sqrt(glide.net_buoyancy * np.sin(-path) / (glide.drag * (DRAG + INDUCED * alpha**2)))
    vertical, horizontal = speed * np.sin(-path), speed * np.cos(path)
    half = glide.depth / vertical
    rows, fixes = [], []
    clock, place = 0.0, np.array([58.0, -52.0])
    current = np.array(glide.current)
    for dive in range(glide.dives):
        heading = np.radians(20.0 + 100.0 * dive)
        fixes += [(clock + wait, *_moved(place, current * wait)) for wait in (0.0, 240.0)]
        place = _moved(place, current * 240.0)
        clock += 240.0
        rows += [(clock - 240.0 + s, 0.5, pitch, heading) for s in np.arange(0.0, 240.0, glide.interval)]
        lasts = 2.0 * half + glide.park
        for s in np.arange(0.0, lasts, glide.interval):
            theta = pitch if s < half else 0.0 if s < half + glide.park else -pitch
            rows.append((clock + s, vertical * min(s, half, lasts - s), theta, heading))
        way = horizontal * np.array([np.cos(heading), np.sin(heading)])
        place = _moved(place, 2.0 * half * way + lasts * current)
        clock += lasts
    fixes += [(clock + wait, *_moved(place, current * wait)) for wait in (0.0, 240.0)]
    rows += [(clock + s, 0.5, pitch, heading) for s in np.arange(1.0, 240.0, glide.interval)]
    time, depth, theta, psi = np.array(rows).T
    at, latitude, longitude = np.array(fixes).T
    error = glide.fix_error / 111_195.0
    latitude = latitude + error * rng.standard_normal(len(at))
    longitude = longitude + error * rng.standard_normal(len(at)) / np.cos(np.radians(58.0))
    return xr.Dataset(
        {
            "depth": ("time", depth, {"units": "m"}),
            "pitch": ("time", np.degrees(theta) + glide.pitch_offset, {"units": "degree"}),
            "heading": ("time", (np.degrees(psi) + glide.heading_offset) % 360.0, {"units": "degree"}),
            "fix_latitude": ("fix", latitude, {"units": "degrees_north"}),
            "fix_longitude": ("fix", longitude, {"units": "degrees_east"}),
        },
        coords={"time": START + (time * 1e9).astype("timedelta64[ns]"),
                "fix_time": ("fix", START + (at * 1e9).astype("timedelta64[ns]"))},
        attrs={"platform": "slocum", "speed": speed, "angle_of_attack": np.degrees(alpha)},
    )  # fmt: skip


def _moved(place, displacement):
    north, east = displacement
    end = Geodesic.WGS84.Direct(*place, np.degrees(np.arctan2(east, north)), float(np.hypot(north, east)))
    return np.array([end["lat2"], end["lon2"]])
