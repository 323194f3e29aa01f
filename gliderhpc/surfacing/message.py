"""Message of a surfacing, as a model with a JSON schema, in which the names of the classes are published."""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from gliderhpc.findings.formatting import polar, with_deviation
from gliderhpc.mission_hull.single_changes import PROBABLE
from gliderhpc.wording import counted

MESSAGE_VERSION = "1.4"
"""Version of the message; the first number changes when a field is removed or changes its meaning."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


def _field(unit: str, what: str) -> Any:
    return Field(description=f"{what} ({unit})" if unit else what)


class Ellipse(_Part):
    """Region of two components that contains the true value with a given probability."""

    probability: float = _field("1", "probability that it contains the true value")
    major: float = _field("", "longer semi-axis, in the unit of the components")
    minor: float = _field("", "shorter semi-axis, in the unit of the components")
    direction: float = _field("degree", "direction of the longer semi-axis, clockwise from north, 0 to 180")


class Current(_Part):
    """Depth-averaged current of the dive."""

    north: float = _field("m s-1", "component to the north")
    east: float = _field("m s-1", "component to the east")
    north_std: float = _field("m s-1", "standard deviation of north")
    east_std: float = _field("m s-1", "standard deviation of east")
    covariance: float = _field("m2 s-2", "covariance of north and east")
    speed: float = _field("m s-1", "speed")
    direction: float = _field("degree", "direction towards which it flows, clockwise from north")
    ellipse: Ellipse
    estimate: str = _field("", "smoothed, or adjoint where the smoother has no current")


class Water(_Part):
    """Motion through the water."""

    speed: float = _field("m s-1", "mean speed along the path")
    horizontal_speed: float = _field("m s-1", "length of the displacement over the dive's duration")
    horizontal_speed_std: float | None = _field("m s-1", "its standard deviation")
    north: float = _field("m", "displacement to the north")
    east: float = _field("m", "displacement to the east")
    north_std: float | None = _field("m", "standard deviation of north")
    east_std: float | None = _field("m", "standard deviation of east")


class Fix(_Part):
    """Time and position."""

    time: str = _field("", "time, ISO 8601, UTC")
    latitude: float = _field("degree_north", "latitude")
    longitude: float = _field("degree_east", "longitude")


class Inversion(_Part):
    """State of the dive in the archive."""

    status: str = _field("", "done or failed")
    message: str = _field("", "reason of a failure, or remarks on the dive")
    windows: int = _field("1", "windows solved")
    converged_fraction: float | None = _field("1", "fraction of the windows that converged")
    smoothed: bool = _field("", "whether the smoother has an estimate")
    seconds: float | None = _field("s", "computing time")


class HullParameter(_Part):
    """Error of one number of the platform file."""

    parameter: str = _field("", "key in the platform file")
    value: float = _field("", "value in the platform file, in its unit")
    plausible_deviation: float = _field("", "plausible standard deviation, in that unit or relative")
    error: float = _field("1", "error estimated from this dive alone, in plausible deviations")
    error_std: float = _field("1", "its standard deviation")


class HullChange(_Part):
    """Change of one number of the platform file over the dives so far, at most the last hundred."""

    parameter: str = _field("", "key in the platform file")
    meaning: str = _field("", "description")
    unit: str = _field("", "unit of value and change")
    first: float = _field("", "value at the first of these dives")
    probability: float = _field("1", "probability that it has changed since the first dive; one half a priori")
    change: float = _field("", "change from the first dive to this one, given that it changed")
    change_std: float = _field("", "standard deviation of change")
    since: int = _field("1", "number of the first dive after the change (median)")
    dives: int = _field("1", "number of dives used")
    above_20_percent: float = _field("1", "probability that it has grown by more than a fifth of first")

    @property
    def size_text(self) -> str:
        """Change with its standard deviation and unit."""
        return f"{with_deviation(self.change, self.change_std)} {self.unit}"

    def is_shown_only_by(self, profile: int) -> bool:
        """Return whether the change begins with this dive, the last one, which alone shows it."""
        return self.since >= profile


class JointPart(_Part):
    """One number of the platform file among those that may have changed together."""

    parameter: str = _field("", "key in the platform file")
    meaning: str = _field("", "description")
    included: float = _field("1", "probability that it is among those that changed, if anything has")
    size: str = Field(
        "",
        description="change with its standard deviation and unit in the most probable combination; empty if not in it",
    )


class JointHullChange(_Part):
    """Change of any of the numbers of the platform file that may change, with one onset, over the dives so far."""

    probability: float = _field("1", "probability that any of them has changed; one half a priori")
    since: int = _field("1", "number of the first dive after the change (median)")
    since_low: int = _field("1", "lower end of the 90 % interval of since")
    since_high: int = _field("1", "upper end of that interval")
    step_probability: float = _field("1", "probability of an abrupt change, if anything has changed")
    combination_probability: float = _field(
        "1", "probability of the most probable combination, if anything has changed"
    )
    parts: tuple[JointPart, ...] = _field("", "numbers that may have changed, the most probable first")
    dives: int = _field("1", "number of dives used")

    @property
    def course(self) -> str:
        """Form and onset of the change."""
        form = "abruptly at" if self.step_probability > 0.5 else "gradually from"
        return f"{form} profile {self.since} ({self.since_low} to {self.since_high})"

    @property
    def cause(self) -> str:
        """Most probable combination, and the probability of each parameter."""
        combination = " and ".join(f"{part.meaning} by {part.size}" for part in self.parts if part.size)
        every = ", ".join(f"{part.meaning} {part.included:.2f}" for part in self.parts)
        if self.combination_probability >= 0.5:
            return f"most probably {combination} ({self.combination_probability:.2f}); probability of each: {every}"
        return (
            f"the dives do not show which parameters (probability of each: {every}); the most probable combination is "
            f"{combination} ({self.combination_probability:.2f})"
        )

    def is_shown_only_by(self, profile: int) -> bool:
        """Return whether the change begins with this dive, the last one, which alone shows it."""
        return self.since >= profile


class Trim(_Part):
    """Difference of the hull from the platform file, from the dives so far, in a unit that a pilot uses."""

    parameter: str = _field("", "key in the platform file")
    quantity: str = _field("", "quantity that can be changed or corrected")
    unit: str = _field("", "unit of difference")
    difference: float = _field("", "last dive minus platform file")
    difference_std: float = _field("", "its standard deviation")
    steps: float = _field(
        "1", "difference in plausible deviations; beyond 3, something other than the hull is probably wrong"
    )


class NextSurfacing(_Part):
    """Predicted end of the next dive, from the displacements and currents of the dives so far, or from its plan."""

    plan: str = Field(
        "", description="planned heading, duration and speed, where given; empty if a dive like those before is assumed"
    )
    time: str = _field("", "time, ISO 8601, UTC")
    latitude: float = _field("degree_north", "latitude")
    longitude: float = _field("degree_east", "longitude")
    ellipse: Ellipse = _field("m", "error ellipse of the position")
    current_north: float = _field("m s-1", "predicted mean current until then, to the north")
    current_east: float = _field("m s-1", "predicted mean current until then, to the east")
    current_ellipse: Ellipse = _field(
        "m s-1", "error ellipse of the predicted current, including the errors of the hull"
    )
    dives: int = _field("1", "number of dives whose currents were used")
    deviation: float = _field("m s-1", "standard deviation of the current's variable part, without the tide")
    correlation_time: float = _field("s", "correlation time of the current's variable part, without the tide")


class SurfacingMessage(_Part):
    """Results of one dive, at its surfacing."""

    version: str = _field("", "version of this message")
    mission: str
    platform: str = _field("", "name of the hull")
    profile: int = _field("1", "number of the profile in the archive")
    revision: int = _field("1", "0 for the first message of a dive; higher if its record has changed since then")
    changes: tuple[str, ...] = _field("", "changes since the previous revision")
    start_time: str = _field("", "first sample, ISO 8601, UTC")
    duration: float = _field("s", "time from the first to the last sample")
    max_depth: float | None = _field("m", "greatest depth")
    samples: int = _field("1", "number of samples")
    surfacing: Fix | None = _field("", "first fix after the dive")
    current: Current | None
    surface_drift: tuple[float, float] | None = _field("m s-1", "drift at the surface, north and east")
    water: Water | None
    next_surfacing: NextSurfacing | None
    inversion: Inversion
    odd: tuple[str, ...] = _field("", "anomalies in the records")
    hull: tuple[HullParameter, ...] = _field("", "errors of the hull from this dive alone, where estimated")
    hull_changes: tuple[HullChange, ...] = _field(
        "", "changes of the parameters that can change, from the fourth dive on"
    )
    hull_joint_change: JointHullChange | None = Field(
        None, description="change of any of these parameters, from the fourth dive on"
    )
    trim: tuple[Trim, ...] = Field(
        (), description="ballast, battery and offsets, where the dives so far determine them"
    )
    hull_warning: str = Field("", description="warnings on trim and changes of the hull")

    @property
    def names_a_change(self) -> bool:
        """Return whether a single parameter of the hull has probably changed."""
        return any(change.probability >= PROBABLE for change in self.hull_changes)

    @property
    def only_current_changed(self) -> bool:
        """Return whether only the current has changed since the previous revision."""
        return bool(self.changes) and all(change.startswith("current ") for change in self.changes)

    def changes_since(self, earlier: str) -> tuple[str, ...]:
        """List the differences from an earlier message, which is passed as JSON."""
        before = SurfacingMessage.model_validate_json(earlier)
        pairs = {
            "samples": (before.samples, self.samples),
            "duration, s": (round(before.duration), round(self.duration)),
            "greatest depth, m": (_round(before.max_depth, 0), _round(self.max_depth, 0)),
            "current north, m/s": (_component(before.current, "north"), _component(self.current, "north")),
            "current east, m/s": (_component(before.current, "east"), _component(self.current, "east")),
            "status": (before.inversion.status, self.inversion.status),
        }
        return tuple(f"{name}: {old} to {new}" for name, (old, new) in pairs.items() if old != new)

    @property
    def line(self) -> str:
        """Summary of the message in one line, for a terminal."""
        parts = [f"dive {self.profile}" + (f" (revision {self.revision})" if self.revision else "")]
        if self.max_depth is not None:
            parts.append(f"{self.max_depth:.0f} m, {self.duration / 60.0:.0f} min")
        if self.current is not None:
            ellipse = self.current.ellipse
            parts.append(f"current {polar(self.current.north, self.current.east)} ± {ellipse.major:.3f}")
        elif self.inversion.status == "done":
            parts.append("current unknown")
        if self.water is not None:
            parts.append(f"through the water {self.water.speed:.3f} m/s")
        if self.surfacing is not None:
            parts.append(f"at {self.surfacing.latitude:.4f}, {self.surfacing.longitude:.4f}")
        if self.next_surfacing is not None:
            following = self.next_surfacing
            position = f"{following.latitude:.4f}, {following.longitude:.4f}"
            parts.append(f"next {following.time[11:16]} at {position} ± {following.ellipse.major:.0f} m")
        if self.inversion.status != "done":
            parts.append(f"failed: {self.inversion.message}")
        elif self.inversion.converged_fraction is not None:
            windows = counted(self.inversion.windows, "window")
            parts.append(f"{self.inversion.converged_fraction:.0%} of {windows} converged")
        if self.odd:
            parts.append(f"anomalies: {'; '.join(self.odd)}")
        return "; ".join(parts)


def _round(value: float | None, digits: int) -> str:
    return "unknown" if value is None else f"{value:.{digits}f}"


def _component(current: Current | None, name: str) -> str:
    return _round(None if current is None else getattr(current, name), 3)
