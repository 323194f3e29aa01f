"""Speed through water and vertical velocity compared with the established methods'; writes ``docs/established-methods.md``.

Usage: ``python -m benchmarks.established_methods NAME=ARCHIVE:OBSERVATIONS ...``: archives of ``run-mission`` with calibrated
hulls, and the imported records that they were made from. Needs gliderflight (extra ``bench``).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from benchmarks.command_line import positional
from benchmarks.glider_flight import EstablishedSolution, density_at_samples, fitted, with_our_weight
from gliderhpc import open_mission
from gliderhpc.archive.profile import SMOOTHED, ProfileData, read_profile_data
from gliderhpc.findings.formatting import markdown
from gliderhpc.observations.format import read_reference
from gliderhpc.platform import Platform
from gliderhpc.studies.archived import chosen_profiles, platform_of
from gliderhpc.studies.library.scores import correlation, rms
from gliderhpc.studies.library.vertical_velocity import VerticalVelocity, vertical_velocity
from gliderhpc.studies.vertical import CommonLevels

Array = np.ndarray
Rows = list[tuple[str, str]]

LEVEL = np.radians(5.0)
STRAIGHT = np.radians(0.3)
"""Roll and rate of turn below which flight counts as straight and level, rad and rad/s."""

UPPER = 100.0
"""Depth (m) above which the density changes most."""

_SECOND = np.timedelta64(1, "s")
_CM = 100.0
_NONE = 1e-9


def difference_of(found: VerticalVelocity, values: Array) -> float:
    """Mean difference of dive and climb over their common levels, for values (n,) at the samples; NaN without any."""
    levels = CommonLevels(found)
    return float(levels.difference(values).mean()) if levels.common else float("nan")


@dataclass(frozen=True, eq=False)
class Profile:
    """One profile at the n samples of the vertical study.

    Attributes
    ----------
    data, found : ProfileData, VerticalVelocity
        What the archive holds, and its vertical velocities.
    adjoint, smoothed : (n,) arrays
        Speed through the water by either estimate, m/s.
    """

    data: ProfileData
    found: VerticalVelocity
    adjoint: Array
    smoothed: Array

    @property
    def known(self) -> Array:
        """Samples with a vertical velocity."""
        return np.isfinite(self.found.water)

    @property
    def straight(self) -> Array:
        """Those of them in straight and level flight."""
        attitude = self.found.attitude
        return self.known & (np.abs(attitude.roll) < LEVEL) & (np.abs(attitude.turn_rate) < STRAIGHT)

    def water_by(self, depth_rate: Array) -> Array:
        """Vertical velocity of the water, upward (m/s), had the hull this depth rate in still water.

        NaN where the rate is missing anywhere in the window.
        """
        missing = self.found.filter.filtered(np.isnan(depth_rate).astype(np.float64))
        rate = self.found.filter.filtered(np.nan_to_num(depth_rate))
        return np.where(np.abs(missing) < _NONE, rate, np.nan) - self.found.measured


@dataclass(frozen=True, eq=False)
class Mission:
    """Comparison of one mission."""

    platform: Platform
    profiles: list[Profile]
    observations: Path
    table: xr.Dataset


def read_mission(archive: Path, observations: Path) -> Mission:
    """Read an archive's finished profiles and find their vertical velocities."""
    with open_mission(archive) as tree:
        platform = platform_of(tree)
        profiles = [_profile(tree, number, platform) for number in chosen_profiles(tree, None)]
        return Mission(platform, [one for one in profiles if one.known.any()], observations, tree.to_dataset().load())


def _profile(tree: xr.DataTree, number: int, platform: Platform) -> Profile:
    data = read_profile_data(tree, number)
    found = vertical_velocity(data, platform)
    speeds = [
        np.linalg.norm(estimate.motion[found.record, 2:5], axis=1)
        for estimate in (data, read_profile_data(tree, number, SMOOTHED))
    ]
    return Profile(data, found, *speeds)


def same_numbers_rows(mission: Mission) -> Rows:
    """The established model's balance under our hull and weight."""
    pairs = [(one, with_our_weight(mission.platform, one.found)) for one in mission.profiles]
    return [
        _counts(mission),
        ("its speed minus the still-water speed: RMS in straight, level flight, mm/s",
         _rms([(theirs.speed - one.found.speed)[one.straight] for one, theirs in pairs], 1e3)),
        ("its depth rate minus ours, with the same filter: RMS, cm/s",
         _rms([_rates(one, theirs)[one.known] for one, theirs in pairs], _CM)),
        ("the same in straight, level flight, cm/s",
         _rms([_rates(one, theirs)[one.straight] for one, theirs in pairs], _CM)),
    ]  # fmt: skip


def own_fit_rows(mission: Mission) -> Rows:
    """The established model fitted by itself to the same samples."""
    with xr.open_dataset(mission.observations) as dataset:
        if "temperature" not in dataset or "practical_salinity" not in dataset:
            return []
        water = [density_at_samples(dataset, one.data, one.found) for one in mission.profiles]
    established, values = fitted(mission.platform, [(one.data, one.found) for one in mission.profiles], water)
    pairs = list(zip(mission.profiles, established, strict=True))
    ours = np.concatenate([one.found.water[one.known] for one in mission.profiles])
    theirs = np.concatenate([one.water_by(their.depth_rate)[one.known] for one, their in pairs])
    speeds = {
        "still-water": [one.found.speed for one in mission.profiles],
        "adjoint's": [one.adjoint for one in mission.profiles],
        "smoother's": [one.smoothed for one in mission.profiles],
    }
    return [
        ("fitted: net mass at the mean density, kg; drag coefficient; compressibility, 1e-6/dbar",
         f"{values['mg'] - mission.platform.mass.total:+.3f}; {values['Cd0']:.3f}; {1e10 * values['epsilon']:.2f}"),
        *((f"{name} speed minus its speed: mean and RMS, m/s",
           _mean_and_rms([(own - their.speed)[one.known] for own, (one, their) in zip(columns, pairs, strict=True)], 1.0))
          for name, columns in speeds.items()),
        ("vertical velocity of the water, ours minus its: mean and RMS, cm/s", _mean_and_rms([ours - theirs], _CM)),
        ("correlation of the two", f"{correlation(ours, theirs):.3f}"),
        ("root mean square of ours, of its, cm/s", f"{_CM * rms(ours):.2f}, {_CM * rms(theirs):.2f}"),
        (f"the same above {UPPER:g} m, and below", _by_depth(mission, ours, theirs)),
        ("dives minus climbs at the same depths, mean of the profiles, ours, cm/s",
         _spread([difference_of(one.found, one.found.water) for one in mission.profiles])),
        ("the same, its, cm/s",
         _spread([difference_of(one.found, one.water_by(their.depth_rate)) for one, their in pairs])),
    ]  # fmt: skip


def source_rows(mission: Mission) -> Rows:
    """The solution that came with the records, where it holds speeds; none where it does not."""
    reference = read_reference(mission.observations)
    if "reference_speed" not in reference or not np.isfinite(reference.reference_speed).any():
        return []
    pairs = [(one, _established_of(one, reference)) for one in mission.profiles]
    chosen = [one.known & np.isfinite(theirs.speed + one.water_by(theirs.depth_rate)) for one, theirs in pairs]
    ours = np.concatenate([one.found.water[own] for (one, _), own in zip(pairs, chosen, strict=True)])
    theirs = np.concatenate(
        [one.water_by(their.depth_rate)[own] for (one, their), own in zip(pairs, chosen, strict=True)]
    )
    rows = [("samples with both", f"{len(ours)}")]
    for name, attribute in (("adjoint's", "adjoint"), ("smoother's", "smoothed")):
        rows.append((
            f"{name} speed minus its speed: mean and RMS, m/s",
            _mean_and_rms([(getattr(one, attribute) - their.speed)[own]
                           for (one, their), own in zip(pairs, chosen, strict=True)], 1.0),
        ))  # fmt: skip
    still = [(one.found.speed - their.speed)[own] for (one, their), own in zip(pairs, chosen, strict=True)]
    return [
        *rows,
        ("still-water speed minus its speed: mean and RMS, m/s", _mean_and_rms(still, 1.0)),
        ("vertical velocity of the water, ours minus its: mean and RMS, cm/s", _mean_and_rms([ours - theirs], _CM)),
        ("correlation of the two", f"{correlation(ours, theirs):.3f}"),
        ("root mean square of ours, of its, cm/s", f"{_CM * rms(ours):.2f}, {_CM * rms(theirs):.2f}"),
        *_dive_averages(mission, reference),
    ]


def _dive_averages(mission: Mission, reference: xr.Dataset) -> Rows:
    """Depth-averaged current, and mean velocity through the water, dive by dive."""
    numbers = np.intersect1d(mission.table.profile.values, reference.reference_profile.values)
    own, theirs = mission.table.sel(profile=numbers), reference.sel(reference_profile=numbers)
    rows = []
    for title, suffix in (("adjoint's", ""), ("smoother's", "_smoothed")):
        difference = [
            own[f"dac_{along}{suffix}"].values - theirs[f"reference_current_{along}"].values
            for along in ("north", "east")
        ]
        rows.append(
            (
                f"depth-averaged current, {title} minus its: RMS to the north, to the east, m/s; dives",
                f"{rms(difference[0]):.3f}, {rms(difference[1]):.3f}; {np.isfinite(difference[0]).sum()}",
            )
        )
    if "reference_flight_north" in theirs:
        flown = np.array([_mean_velocity(one.data) for one in mission.profiles if one.data.number in numbers])
        at = [int(n) for n in numbers if n in {one.data.number for one in mission.profiles}]
        north, east = (
            theirs[f"reference_flight_{along}"].sel(reference_profile=at).values for along in ("north", "east")
        )
        rows.append(
            (
                "mean velocity through the water over a dive, adjoint's minus its: RMS to the north, to the east, m/s",
                f"{rms(flown[:, 0] - north):.3f}, {rms(flown[:, 1] - east):.3f}",
            )
        )
    return rows


def _mean_velocity(data: ProfileData) -> Array:
    return (data.motion[-1, :2] - data.motion[0, :2]) / (data.record_time[-1] - data.record_time[0])


def _established_of(one: Profile, reference: xr.Dataset) -> EstablishedSolution:
    """The source's speeds at the samples; NaN half a window away from any of them."""
    time = (reference.reference_time.values - one.data.epoch) / _SECOND
    at = one.data.record_time[one.found.record]
    nearest = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    apart = np.minimum(np.abs(time[nearest] - at), np.abs(at - time[nearest - 1]))
    values = [
        np.where(apart < one.found.filter.window / 2.0, np.interp(at, time, reference[name].values), np.nan)
        for name in ("reference_vertical_speed", "reference_speed")
    ]
    return EstablishedSolution(-values[0], values[1])


def _rates(one: Profile, theirs: EstablishedSolution) -> Array:
    return one.found.filter.filtered(theirs.depth_rate) - one.found.model


def _counts(mission: Mission) -> tuple[str, str]:
    known, straight = (sum(int(getattr(one, name).sum()) for one in mission.profiles) for name in ("known", "straight"))
    return "profiles; samples; of these straight and level", f"{len(mission.profiles)}; {known}; {straight}"


def _rms(parts: Sequence[Array], factor: float) -> str:
    return f"{factor * rms(np.concatenate(parts)):.3f}"


def _mean_and_rms(parts: Sequence[Array], factor: float) -> str:
    values = factor * np.concatenate(parts)
    return f"{np.nanmean(values):+.3f}, {rms(values):.3f}"


def _by_depth(mission: Mission, ours: Array, theirs: Array) -> str:
    upper = np.concatenate([one.found.attitude.depth[one.known] for one in mission.profiles]) < UPPER
    return "; ".join(f"{_CM * rms(ours[part]):.2f}, {_CM * rms(theirs[part]):.2f}" for part in (upper, ~upper))


def _spread(values: Sequence[float]) -> str:
    known = _CM * np.array([value for value in values if np.isfinite(value)])
    if not len(known):
        return "no depth met on both"
    return f"{known.mean():+.2f} (from {known.min():+.2f} to {known.max():+.2f}, {len(known)} profiles)"


def table_of(columns: dict[str, Rows]) -> str:
    """Markdown with one column a mission."""
    first = next(iter(columns.values()))
    rows = [[what, *(rows[index][1] for rows in columns.values())] for index, (what, _) in enumerate(first)]
    return markdown(("", *columns), rows, tuple(columns))


METHOD = Path(__file__).with_name("established_methods.md")
"""Text of the page before its figures."""

SECTIONS = (
    ("## The established model with our hull's parameters", same_numbers_rows),
    ("## The established model fitted separately", own_fit_rows),
    ("## The solution that came with the records", source_rows),
)


def page(missions: dict[str, Mission]) -> str:
    """Text of the page."""
    lines = [METHOD.read_text("utf-8").rstrip(), ""]
    for title, rows_of in SECTIONS:
        columns = {name: rows for name, mission in missions.items() if (rows := rows_of(mission))}
        if columns:
            lines += [title, "", table_of(columns), ""]
    return "\n".join(lines).rstrip() + "\n"


def main(labels: Sequence[str]) -> None:
    """Compare the missions, given as ``NAME=ARCHIVE:OBSERVATIONS``, and write the page."""
    missions = {}
    for label in labels:
        name, _, rest = label.partition("=")
        archive, _, observations = rest.rpartition(":")
        missions[name] = read_mission(Path(archive), Path(observations))
    docs = Path(__file__).resolve().parents[1] / "docs"
    (docs / "established-methods.md").write_text(page(missions), "utf-8")


if __name__ == "__main__":
    main(positional(__doc__, missions={"nargs": "+"}).missions)
