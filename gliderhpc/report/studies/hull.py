"""Tables, figure and verdict of study ``hull``, from its group of an archive alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.reader import Archive
from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.drawing import LANDSCAPE, MODEL, SHADE, SMOOTHER, footnote, label, legend, panel_letters, panels
from gliderhpc.findings.formatting import number
from gliderhpc.findings.results import Findings, archive_findings
from gliderhpc.flight.hull_parameters import HullParameter, hull_parameters
from gliderhpc.mission_hull.single_changes import POSSIBLE, PROBABLE
from gliderhpc.platform import Platform
from gliderhpc.report.studies.summaries import describe_data
from gliderhpc.store_schema.schema import COMPLETE
from gliderhpc.studies.archived import (
    failed_profiles,
    mission_of,
    platform_of,
    provenance_of,
    stored_attribute,
    study_table,
)
from gliderhpc.studies.hull import CHANGE_COLUMNS, JOINT, NAME, STATEMENTS, SUSPECT
from gliderhpc.surfacing.recent_hull import (
    MUST_BE_CONFIRMED,
    UNDETERMINED,
    PilotUnit,
    implausible_warning,
    joint_sentence,
    pilot_units,
    read_joint_change,
    size_text,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


_DRAG, _VOLUME = "viscous.K_D0", "buoyancy.neutral_volume"
_NORMAL_95 = 1.96
_ROUNDING = 1e-9
"""Ratio to the half width of an interval below which a difference is due to rounding."""

_DOUBTED = 0.5
"""Weight below which a dive is listed as doubtful."""

_NOTE = (
    "Line and band: value from all dives and its 95 % interval. Points: value from the dives up to each, as known at "
    "that time. Dashed: value of the platform file. Shaded: 90 % interval of the onset where a change is probable. "
    "The intervals include the scatter between dives, but not errors that are the same in every dive and are not "
    "among the parameters."
)


@dataclass(frozen=True, eq=False)
class HullHistory:
    """Findings of the study in group ``hull`` of an archive, at the profiles with information on the hull.

    Attributes
    ----------
    platform : Platform
        Hull used to estimate the mission.
    group : xarray.Dataset
        Group at these profiles.
    days : (n,)
        Time since the mission's first observation, days.
    """

    platform: Platform
    group: xr.Dataset
    days: Array

    def series(self, name: str, key: str) -> Array:
        """Return the values (n,) of a variable for one parameter."""
        return np.asarray(self.group[name].sel(parameter=key).values, dtype=np.float64)

    @cached_property
    def parameters(self) -> tuple[HullParameter, ...]:
        """Parameters of hull and records that have an estimate; an archive of an earlier version has fewer."""
        known = np.isfinite(self.group["estimate"].values).any(axis=0)
        keys = {str(key) for key in self.group["parameter"].values[known]}
        return tuple(p for p in hull_parameters(self.platform) if p.key in keys)

    @cached_property
    def suspects(self) -> tuple[HullParameter, ...]:
        """Parameters that may change during the mission."""
        known = {p.key: p for p in self.parameters}
        return tuple(known[str(key)] for key in self.group[SUSPECT].values)

    def change(self, key: str) -> dict[str, float]:
        """Return the findings on a change of one of the `suspects`, by variable."""
        keys = [str(name) for name in self.group[SUSPECT].values]
        return {name: float(self.group[name].values[keys.index(key)]) for name in CHANGE_COLUMNS}


def read_history(archive: Archive, profiles: Sequence[int]) -> HullHistory:
    """Read the study's findings at the profiles with an estimate."""
    group = archive[NAME].to_dataset().drop_vars([*STATEMENTS], errors="ignore").load().sel(profile=list(profiles))
    known = np.isfinite(group["estimate"].values).any(axis=1)
    days = archive.to_dataset()["elapsed_days"].sel(profile=list(profiles)).values
    return HullHistory(platform_of(archive), group.isel(profile=known), np.asarray(days[known], dtype=np.float64))


def parameter_table(history: HullHistory) -> pd.DataFrame:
    """Tabulate the parameters: unit, platform file, last dive with 95 % interval, remaining plausible deviation."""
    rows = []
    for p in history.parameters:
        value, std = (float(history.series(name, p.key)[-1]) for name in ("estimate", "estimate_std"))
        rows.append(
            {
                "parameter": p.key,
                "meaning": p.meaning,
                "unit": p.unit,
                "platform file": p.value(history.platform),
                "estimate": value,
                "low": value - _NORMAL_95 * std,
                "high": value + _NORMAL_95 * std,
                "remaining": std / abs(p.slope(history.platform, p.steps(history.platform, value))),
                "steps": p.steps(history.platform, value),
            }
        )
    return pd.DataFrame(rows)


def implausible_lines(parameters: pd.DataFrame) -> tuple[str, ...]:
    """Warn of values too far from the platform file to be errors of the hull."""
    warning = implausible_warning(dict(zip(parameters["parameter"], parameters["steps"], strict=True)))
    return (warning,) if warning else ()


def change_table(history: HullHistory) -> pd.DataFrame:
    """Tabulate the parameters that may change: probability, size (95 % interval), onset (90 % interval), form."""
    rows = []
    for p in history.suspects:
        change = history.change(p.key)
        total, std = change["change_total"], change["change_total_std"]
        rows.append(
            {
                "parameter": p.key,
                "unit": p.unit,
                "probability": change["change_probability"],
                "change": total,
                "low": total - _NORMAL_95 * std,
                "high": total + _NORMAL_95 * std,
                "since profile": change["onset"],
                "since, low": change["onset_low"],
                "since, high": change["onset_high"],
                "step": change["step_probability"],
            }
        )
    return pd.DataFrame(rows)


def verdict_lines(history: HullHistory) -> tuple[str, ...]:
    """Return one sentence for each parameter that may change: probability, size and onset of a change."""
    return tuple(_verdict(history, p) for p in history.suspects)


def _verdict(history: HullHistory, p: HullParameter) -> str:
    change = history.change(p.key)
    probability = change["change_probability"]
    if not np.isfinite(probability):
        return f"{p.meaning}: too few dives to detect a change"
    if probability < POSSIBLE:
        shown = "no change detected" if _is_judged(history, p) else "the dives cannot reveal a change"
        return f"{p.meaning}: {shown} (probability {probability:.2f})"
    low, high = sorted((change["onset_low"], change["onset_high"]))
    form = "abruptly at" if change["step_probability"] > 0.5 else "gradually from"
    size = size_text(p, float(history.series("estimate", p.key)[0]), change["change_total"], change["change_total_std"])
    course = f"{form} profile {change['onset']:.0f} ({low:.0f} to {high:.0f}), by {size}"
    if probability < PROBABLE:
        return f"{p.meaning}: possibly changed {course} (probability {probability:.2f}); more dives can confirm it"
    if change["onset"] >= _last_dive(history):
        return f"{p.meaning}: changed {course} (probability {probability:.3f}); {MUST_BE_CONFIRMED}"
    return (
        f"{p.meaning}: changed {course} (probability {probability:.3f}); the currents are those of one hull for all "
        "profiles, so calibrate those before and after the change separately"
    )


def _is_judged(history: HullHistory, p: HullParameter) -> bool:
    """Return whether the dives would determine the size of a change better than its prior does."""
    first = p.steps(history.platform, float(history.series("estimate", p.key)[0]))
    std = history.change(p.key)["change_total_std"] / abs(p.slope(history.platform, first))
    return bool(std < UNDETERMINED)


def joint_lines(history: HullHistory) -> tuple[str, ...]:
    """Return a sentence on the change of any parameter; empty if it was not studied, as with too few dives."""
    found = history.group.attrs.get(JOINT)
    if found is None:
        return ()
    first = {p.key: float(history.series("estimate", p.key)[0]) for p in history.suspects}
    joint = read_joint_change(found, history.suspects, first, len(history.days))
    return (joint_sentence(joint, named=bool(_changed(history)), last=_last_dive(history)),)


def _last_dive(history: HullHistory) -> int:
    """Number of the last dive with information on the hull."""
    return int(history.group["profile"].values[-1])


def _changed(history: HullHistory) -> list[HullParameter]:
    """Parameters that have probably changed, each judged by itself."""
    return [p for p in history.suspects if history.change(p.key)["change_probability"] >= PROBABLE]


def pilot_rows(history: HullHistory) -> tuple[Comparison, ...]:
    """Return the differences of the hull at the last dive from the platform file, in the units that a pilot uses."""
    keys = {p.key for p in history.parameters}
    return tuple(
        _pilot_row(history, quantity) for quantity in pilot_units(history.platform) if quantity.parameter in keys
    )


def _pilot_row(history: HullHistory, quantity: PilotUnit) -> Comparison:
    p = next(p for p in history.parameters if p.key == quantity.parameter)
    value, std = (float(history.series(name, p.key)[-1]) for name in ("estimate", "estimate_std"))
    apart, half = quantity.scale * (value - p.value(history.platform)), _NORMAL_95 * abs(quantity.scale) * std
    # The rounding of a value that was converted back and forth is not a difference.
    apart = apart if abs(apart) > _ROUNDING * half else 0.0
    interval = "spread: 95 % interval"
    return Comparison(
        quantity.quantity,
        quantity.unit,
        apart,
        spread=(apart - half, apart + half),
        remark=f"{interval}; {quantity.remark}" if quantity.remark else interval,
    )


def hull_figure(history: HullHistory, title: str) -> Figure:
    """Draw every parameter that may change over the mission's days."""
    count = len(history.suspects)
    rows = max(1, -(-count // 2))
    figure, axes = panels(rows, min(2, max(1, count)), LANDSCAPE, f"Hull estimated from the dives: {title}")
    for letter, p, panel in zip(panel_letters(count), history.suspects, axes, strict=False):
        label(panel, f"({letter}) {p.meaning}, {p.key}", "days", p.unit)
        _draw(panel, history, p)
    legend(axes[0])
    footnote(figure, _NOTE)
    return figure


def _draw(axes: Axes, history: HullHistory, p: HullParameter) -> None:
    value, std, then = (history.series(name, p.key) for name in ("estimate", "estimate_std", "estimate_sequential"))
    axes.fill_between(
        history.days,
        value - _NORMAL_95 * std,
        value + _NORMAL_95 * std,
        color=MODEL,
        alpha=0.2,
        linewidth=0.0,
        label="95 % interval",
    )
    axes.plot(history.days, value, color=MODEL, linewidth=1.2, label="all dives")
    axes.plot(history.days, then, ".", color=SMOOTHER, markersize=4.0, label="dives up to each")
    axes.axhline(p.value(history.platform), color="#666666", linestyle="--", linewidth=0.8, label="platform file")
    change = history.change(p.key)
    if change["change_probability"] >= PROBABLE:
        day = dict(zip(history.group["profile"].values.tolist(), history.days.tolist(), strict=True))
        axes.axvspan(
            day[int(change["onset_low"])], day[int(change["onset_high"])], color=SHADE, alpha=0.3, linewidth=0.0
        )


def show(archive: Archive) -> Findings:
    """Show the study of an archive."""
    provenance, table = provenance_of(archive, NAME), study_table(archive, NAME)
    failed, known = failed_profiles(table)
    history = read_history(archive, provenance.profiles)
    parameters = parameter_table(history)
    inflation = float(stored_attribute(archive, NAME, "inflation"))
    verdict = (*joint_lines(history), *verdict_lines(history))
    doubted = known.loc[known["weight"] < _DOUBTED, "profile"].astype(int).tolist()
    comparisons = (
        *pilot_rows(history),
        Comparison("ratio of the variance between dives to the stated variance", "1", inflation),
        Comparison("dives that do not fit the others (weight below one half)", "1", float(len(doubted))),
    )
    facts = {
        "profiles": list(provenance.profiles), "quick": provenance.quick, "verdict": list(verdict),
        "inflation": inflation, "log_evidence": stored_attribute(archive, NAME, "log_evidence"), "doubted": doubted,
    }  # fmt: skip
    data = describe_data(provenance, known["profile"].astype(int).tolist())
    return archive_findings(
        NAME,
        comparisons=comparisons,
        tables={"parameters": parameters, "changes": change_table(history), "profiles": table},
        figures={"hull": partial(hull_figure, history, mission_of(archive))},
        facts=facts,
        failed=failed,
        remarks=(*verdict, *implausible_lines(parameters), *provenance.remarks),
        captions=_captions(parameters, data),
    )


def _captions(parameters: pd.DataFrame, data: str) -> dict[str, str]:
    determined = int((parameters["remaining"] < UNDETERMINED).sum())
    return {
        "hull": f"Parameters that may change during the mission, {data}. {_NOTE}",
        "parameters": (
            f"Hull and records at the last dive: {data}. *remaining* is the deviation after the dives over the "
            f"plausible one; for {determined} of {len(parameters)} parameters it is below {number(UNDETERMINED)}. "
            "*steps* is the distance from the platform file in plausible deviations. Intervals are 95 % intervals."
        ),
        "changes": (
            f"Changes from the first dive to the last: {data}. Probabilities begin at one half; every dive but the "
            "first may be the onset of a step or of a ramp. Size (95 % interval), onset (90 %) and form assume that "
            "there was a change."
        ),
        "profiles": f"One row per profile: {data}. chi_square is its distance from the others, weight its weight.",
    }


def change_findings(archive: Archive) -> tuple[bool, tuple[str, ...]] | None:
    """Return whether the study found any change, and its sentences on the drag and on the changes found.

    None if the drag was not studied.
    """
    history = _stored_history(archive)
    if history is None:
        return None
    drag = next((p for p in history.suspects if p.key == _DRAG), None)
    if drag is None or not np.isfinite(history.change(_DRAG)["change_probability"]):
        return None
    changed = _changed(history)
    others = [p for p in changed if p.key != _DRAG]
    joint = () if changed else _shown_jointly(history)
    return bool(changed or joint), (*joint, *(_verdict(history, p) for p in (drag, *others)))


def _shown_jointly(history: HullHistory) -> tuple[str, ...]:
    """Return the sentence on the change of any parameter where a change is probable, otherwise nothing."""
    found = history.group.attrs.get(JOINT)
    return joint_lines(history) if found is not None and found["probability"] >= PROBABLE else ()


@dataclass(frozen=True)
class StoredChange:
    """Change of one parameter: key, unit, size and standard deviation in that unit, probability, and a sentence."""

    key: str
    unit: str
    size: float
    std: float
    probability: float
    sentence: str


def stored_changes(archive: Archive) -> tuple[StoredChange, ...] | None:
    """Return the changes found by the complete study of an archive; None if there is no such study.

    A change that the parameters show only together has no key and no size.
    """
    history = _stored_history(archive)
    if history is None:
        return None
    joint = () if _changed(history) else _shown_jointly(history)
    unknown = float("nan")
    return (
        *(StoredChange("", "", unknown, unknown, history.group.attrs[JOINT]["probability"], line) for line in joint),
        *notable_changes(history),
    )


def notable_changes(history: HullHistory) -> tuple[StoredChange, ...]:
    """Return the findings on drag and neutral volume, and on any other parameter that probably changed."""
    changed = [(p, history.change(p.key)) for p in history.suspects]
    return tuple(
        StoredChange(
            p.key,
            p.unit,
            change["change_total"],
            change["change_total_std"],
            change["change_probability"],
            _verdict(history, p),
        )
        for p, change in changed
        if p.key in (_DRAG, _VOLUME) or change["change_probability"] >= PROBABLE
    )


def _stored_history(archive: Archive) -> HullHistory | None:
    """Read the findings of the study if the archive contains it complete, otherwise return None."""
    if NAME not in archive.children or not archive[NAME].attrs.get(COMPLETE, False):
        return None
    return read_history(archive, provenance_of(archive, NAME).profiles)
