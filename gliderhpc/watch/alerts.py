"""Alerts of a watch: rules for the message of a surfacing, and the command or address notified of a violation."""

import json
import subprocess
import urllib.request
from collections.abc import Iterator, Mapping
from http.client import HTTPException
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field, model_validator

from gliderhpc.errors import first_line
from gliderhpc.findings.formatting import polar
from gliderhpc.shipped import describe_unknown_key
from gliderhpc.surfacing.message import SurfacingMessage
from gliderhpc.yaml_text import number_rule, read_model, shown

_DRAG = "viscous.K_D0"


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Box(_Section):
    """Limits of latitude and longitude, degrees; the box extends eastwards from `west` to `east`, even across 180."""

    south: float = Field(ge=-90.0, le=90.0)
    north: float = Field(ge=-90.0, le=90.0)
    west: float = Field(ge=-180.0, le=360.0)
    east: float = Field(ge=-180.0, le=360.0)

    @model_validator(mode="after")
    def _check_order(self) -> "Box":
        if self.south > self.north:
            raise ValueError(f"south ({self.south:g}) is greater than north ({self.north:g}); swap them")
        return self

    def contains(self, latitude: float, longitude: float) -> bool:
        """Return whether a position lies in the box."""
        width = self.east - self.west
        inside = width >= 360.0 or (longitude - self.west) % 360.0 <= width % 360.0
        return self.south <= latitude <= self.north and inside


class Rules(_Section):
    """Limits whose violation raises an alert, each optional.

    Attributes
    ----------
    current_above : float, optional
        Largest speed of the depth-averaged current without an alert, m/s.
    converged_below : float, optional
        Smallest fraction of converged windows without an alert; a dive that failed or has no smoothed estimate raises
        an alert too.
    next_surfacing_outside : Box, optional
        Box within which the next surfacing should be.
    hull_changed : float, optional
        Lowest probability of a change of drag, lift, neutral volume, roll trim or the pitch sensor, or of any of these,
        that raises an alert, from the second changed dive on.
    drag_up_fifth : float, optional
        Lowest probability of an increase in drag by more than a fifth that raises an alert, from the second changed
        dive on.
    """

    current_above: float | None = Field(None, ge=0.0)
    converged_below: float | None = Field(None, ge=0.0, le=1.0)
    next_surfacing_outside: Box | None = None
    hull_changed: float | None = Field(None, gt=0.0, lt=1.0)
    drag_up_fifth: float | None = Field(None, gt=0.0, lt=1.0)

    def violations(self, message: SurfacingMessage) -> tuple[str, ...]:
        """Return a sentence for each rule that a message breaks; of a late current, only for the rule on currents."""
        if message.only_current_changed:
            return tuple(self._current(message))
        return (
            *self._current(message), *self._convergence(message), *self._next_surfacing(message), *self._hull(message),
            *self._hull_as_a_whole(message),
        )  # fmt: skip

    def _current(self, message: SurfacingMessage) -> Iterator[str]:
        current, limit = message.current, self.current_above
        if limit is not None and current is not None and current.speed > limit:
            error = f"± {current.ellipse.major:.3f} ({current.ellipse.probability:.0%})"
            yield f"current {polar(current.north, current.east)} {error}, over {limit:g} m/s"

    def _convergence(self, message: SurfacingMessage) -> Iterator[str]:
        inversion, limit = message.inversion, self.converged_below
        if limit is None:
            return
        if inversion.status != "done":
            yield f"not inverted: {inversion.message}"
        elif not inversion.smoothed:
            yield "the smoother has no estimate"
        elif inversion.converged_fraction is not None and inversion.converged_fraction < limit:
            yield f"{inversion.converged_fraction:.1%} of the windows converged, under {limit:.1%}"

    def _next_surfacing(self, message: SurfacingMessage) -> Iterator[str]:
        following, box = message.next_surfacing, self.next_surfacing_outside
        if box is not None and following is not None and not box.contains(following.latitude, following.longitude):
            position = f"{following.latitude:.4f}, {following.longitude:.4f}"
            yield f"next surfacing at {position} ± {following.ellipse.major:.0f} m, outside the box"

    def _hull(self, message: SurfacingMessage) -> Iterator[str]:
        for change in message.hull_changes:
            # The water often causes one unusual dive; the next dive decides.
            if change.is_shown_only_by(message.profile):
                continue
            if self.hull_changed is not None and change.probability >= self.hull_changed:
                size = f"{change.change:+.3g} {change.unit}, standard deviation {change.change_std:.2g}"
                probability = f"probability {change.probability:.3f}"
                yield f"{change.meaning}: changed since dive {change.since} by {size} ({probability})"
            if (
                self.drag_up_fifth is not None
                and change.parameter == _DRAG
                and change.above_20_percent >= self.drag_up_fifth
            ):
                yield f"drag up by more than 20 % (probability {change.above_20_percent:.3f}) since dive {change.since}"

    def _hull_as_a_whole(self, message: SurfacingMessage) -> Iterator[str]:
        """Yield a sentence on a change that the parameters show together, but none of them alone."""
        joint, limit = message.hull_joint_change, self.hull_changed
        if joint is None or limit is None or joint.probability < limit or joint.is_shown_only_by(message.profile):
            return
        if all(change.probability < limit for change in message.hull_changes):
            probability = f"probability {joint.probability:.3f}"
            yield f"hull as a whole: something has changed {joint.course} ({probability}); {joint.cause}"


class Alerts(_Section):
    """Rules, and the command or address that is notified.

    Attributes
    ----------
    rules : Rules
        The rules.
    command : tuple of str
        Program and arguments, run without a shell. The path of the message is the last argument, and the alert is the
        standard input, as JSON with ``alerts`` and ``message``.
    webhook : str, optional
        Address to which the same JSON is posted.
    timeout : float
        Longest time that the command or the post may take, s.
    """

    rules: Rules
    command: tuple[str, ...] = ()
    webhook: str | None = Field(None, pattern=r"^https?://")
    timeout: float = Field(30.0, gt=0.0, le=600.0)

    def check_and_send(self, message: SurfacingMessage, path: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Check the rules, and send the alerts.

        Returns
        -------
        alerts, failures : tuple of str
            A sentence for each broken rule, and for each failure to send the alerts.
        """
        alerts = self.rules.violations(message)
        if not alerts:
            return (), ()
        content = json.dumps({"alerts": alerts, "message": message.model_dump(mode="json")})
        return alerts, (*self._run(content, path), *self._post(content))

    def _run(self, content: str, path: Path) -> Iterator[str]:
        if not self.command:
            return
        try:
            done = subprocess.run(
                [*self.command, str(path)],
                input=content.encode(),
                timeout=self.timeout,
                check=False,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        except subprocess.TimeoutExpired:
            yield f"{self.command[0]}: did not finish within {self.timeout:g} s"
        except OSError as error:
            yield f"{self.command[0]}: cannot be run: {error.strerror or error}"
        else:
            if done.returncode:
                yield f"{self.command[0]}: ended with status {done.returncode}"

    def _post(self, content: str) -> Iterator[str]:
        if self.webhook is None:
            return
        request = urllib.request.Request(self.webhook, content.encode(), {"Content-Type": "application/json"})
        try:
            with urllib.request.urlopen(request, timeout=self.timeout):
                return
        except (OSError, ValueError, HTTPException) as error:
            # The path of a webhook is often a secret token, so only the host is named.
            yield f"{urlsplit(self.webhook).hostname}: {first_line(error)}"


def read_alerts(path: Path) -> Alerts:
    """Read a file of alerts.

    Raises
    ------
    InputError
        The file cannot be read, or a key or value cannot be used.
    """
    return read_model(path, "alerts", Alerts, _describe_fault)


_SECTIONS: dict[str, type[_Section]] = {"": Alerts, "rules": Rules, "rules.next_surfacing_outside": Box}
_EXPECTED = {
    "rules": "the rules as `key: value` pairs, such as {current_above: 0.5}",
    "rules.next_surfacing_outside": "the limits south, north, west and east, degrees",
    "command": "a list of program and arguments, such as [mail, -s, glider, pilot@example.org]",
    "webhook": "an address that begins with http:// or https://",
}


def _describe_fault(fault: Mapping[str, Any]) -> str:
    *parents, last = map(str, fault["loc"] or ("",))
    key = ".".join((*parents, last))
    if not key:
        return "contains no alerts; it must have the key rules, and may have command, webhook and timeout"
    if fault["type"] == "extra_forbidden":
        return describe_unknown_key(key, list(_SECTIONS[".".join(parents)].model_fields))
    if fault["type"] == "missing":
        return f"missing key '{key}'; add it"
    if fault["type"] == "value_error":
        return f"{key}: {fault['ctx']['error']}"
    expected = _EXPECTED.get(key, _EXPECTED.get(str(fault["loc"][0]), ""))
    reason = number_rule(fault) or (f"give {expected}" if expected else fault["msg"][:1].lower() + fault["msg"][1:])
    return f"{key} is {shown(fault['input'])}: {reason}"
