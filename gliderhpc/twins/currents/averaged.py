"""One twin's depth-averaged current as a row: what coverage is counted from."""

from gliderhpc.twins.depth_averaged import twin_current
from gliderhpc.twins.inversion import TwinInversion
from gliderhpc.twins.runs import Row
from gliderhpc.twins.scoring import motion_scores


def averaged_row(inversion: TwinInversion) -> Row:
    """Estimated and true current (m/s), the modelled track (m), what was bridged of it, and the time it drifted.

    Beside them the error of the mean motion through the water along and across the true track, m/s.
    """
    current = twin_current(inversion)
    north, east = current.velocity.tolist()
    true_north, true_east = current.truth.tolist()
    drift = current.drift
    track_north, track_east = drift.track.tolist()
    motion = motion_scores(inversion)
    return {
        "current_north": true_north,
        "current_east": true_east,
        "estimate_north": north,
        "estimate_east": east,
        "track_north": track_north,
        "track_east": track_east,
        "bridged": drift.bridged,
        "duration": drift.elapsed,
        "position_variance": drift.position_variance,
        **{name: motion[name] for name in ("velocity_along", "velocity_across", "water_speed")},
    }
