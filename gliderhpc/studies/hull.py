"""Study ``hull``: errors of the hull and the records profile by profile, and their changes during the mission.

The archive's group ``hull`` has each profile's information on the errors, written by `run-mission` (docs/smoother.md).
The sum over the mission, with a random walk for the errors that can change, gives the errors at every profile, both
from all profiles and from the profiles up to that one. A step or a ramp that starts at some profile is compared with no
change. The results are added to the same group.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from threadpoolctl import threadpool_limits

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import done_profiles
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError
from gliderhpc.estimation.settings import Settings
from gliderhpc.estimation.smoother.hull_errors import stated_errors
from gliderhpc.estimation.smoother.information import semidefinite
from gliderhpc.flight.hull_parameters import HullParameter, among_parameters, hull_parameters
from gliderhpc.mission_hull.estimate import HullPrior, MissionHull, ProfileTerm, solve_mission
from gliderhpc.mission_hull.gaussian_chain import Gaussian
from gliderhpc.mission_hull.joint_change import JointChange, find_hull_changes
from gliderhpc.mission_hull.single_changes import PROBABLE, ErrorChange
from gliderhpc.observations.profile_numbers import select_profiles
from gliderhpc.platform import Platform
from gliderhpc.store_schema.schema import PROFILE
from gliderhpc.studies.archived import chosen_profiles, platform_of
from gliderhpc.studies.library.depth_rate_check import DepthRateCheck, check_hull, read_glides
from gliderhpc.studies.request import Request
from gliderhpc.studies.study import GroupContent, Plan, Preparation, Row, Study
from gliderhpc.vocabulary import HULL_PARAMETERS
from gliderhpc.wording import counted

Array = NDArray[np.float64]

NAME = "hull"

JOINT = "joint_change"
"""Attribute with the change of any of the parameters that may change (`joint_in_units`)."""

SUSPECT = "suspect"
"""Dimension of the parameters that may change during the mission."""

STATEMENTS = ("score", "information", "score_other", "information_other")
"""Variables with a profile's information on the hull."""

_SINGULAR = 1e-9
"""Number added to the prior's variances, because a calibration may state some as zero."""

CALIBRATED = (
    "the platform file's covariance is used as prior; if the file was calibrated on these dives, they count twice and "
    "the intervals are too narrow"
)

MODEL_ERRORS = (
    "the intervals of the values include the effect of the assumed noise of the disturbances; other errors that are "
    "the same in every dive, such as rounded angles, shift values, but not changes"
)


class HullSettings(Settings):
    """Settings of the sum over the profiles."""

    robust: bool = Field(
        True, description="whether scatter between the profiles reduces their weight, and that of outliers further"
    )
    change: float = Field(
        1.0, gt=0, description="plausible size of a change during the mission, in the parameter's plausible deviations"
    )


COMPANIONS = {"buoyancy.neutral_volume": "position.battery"}
"""Parameter that may change together with another one. Weight that is lost or gained also trims the glider, unless it
acts where the oil does, whose volume the parameter is."""


@dataclass(frozen=True, eq=False)
class MissionTerms:
    """Hull of a mission, the parameters that have an effect, and the profiles' information on them.

    Attributes
    ----------
    platform : Platform
        Hull that the mission was estimated with.
    parameters : tuple of HullParameter
        Errors of the hull and the records.
    terms : tuple of ProfileTerm
        Terms of the profiles with information, in order of time.
    without : tuple of int
        Numbers of the profiles without information.
    labels : tuple of str
        Keys along the archive's dimension ``parameter``; an archive of an earlier version has fewer.
    divisor : float
        Number by which the sum divides the information of every profile (`gliderhpc.studies.library.depth_rate_check`).
    undivided : MissionHull, optional
        Sum of the undivided information, if it was computed to find the divisor.
    """

    platform: Platform
    parameters: tuple[HullParameter, ...]
    terms: tuple[ProfileTerm, ...]
    without: tuple[int, ...]
    labels: tuple[str, ...] = HULL_PARAMETERS
    divisor: float = 1.0
    undivided: MissionHull | None = None

    @property
    def prior(self) -> HullPrior:
        """Prior from the platform file, before any profile."""
        stated = stated_errors(self.platform, self.parameters)
        covariance = stated.covariance + _SINGULAR * np.eye(len(stated.mean))
        return HullPrior(Gaussian(stated.mean, covariance), np.array([p.walk(self.platform) for p in self.parameters]))

    @property
    def suspects(self) -> tuple[int, ...]:
        """Positions of the parameters that may change."""
        return tuple(int(i) for i in np.flatnonzero(self.prior.walk > 0.0))

    @property
    def companions(self) -> dict[int, int]:
        """Positions of the parameters that may change together with one that may change, by the latter's position."""
        keys = [p.key for p in self.parameters]
        return {
            keys.index(key): keys.index(companion)
            for key, companion in COMPANIONS.items()
            if key in keys and companion in keys
        }


def read_terms(archive: Archive, numbers: Sequence[int]) -> MissionTerms:
    """Read the hull information of an archive's profiles."""
    platform = platform_of(archive)
    at = {PROFILE: list(numbers)}
    group = archive[NAME].to_dataset()[[*STATEMENTS]].sel(at).load()
    times = archive.to_dataset()["start_time"].sel(at).values
    # The archive lists every hull parameter of its version; those that have an effect are the ones with a score.
    acts = np.isfinite(group["score"].values).any(axis=0)
    labels = tuple(str(key) for key in group["parameter"].values)
    parameters = tuple(p for p in hull_parameters(platform) if p.key in labels and acts[labels.index(p.key)])
    positions = [labels.index(p.key) for p in parameters]
    # A parameter without effect in a profile, such as one of the unused buoyancy model, has no information there.
    known = np.isfinite(group["score"].values[:, positions]).any(axis=1)
    scores, matrices, other_scores, other_matrices = (
        np.nan_to_num(group[name].values[known][..., positions]) for name in STATEMENTS
    )
    start = np.zeros(len(parameters))
    terms = [
        ProfileTerm(number, time, start, score, matrix[positions], tuple(zip(others, other[:, positions], strict=True)))
        for number, time, score, matrix, others, other in zip(
            np.array(numbers)[known].tolist(), times[known], scores, matrices, other_scores, other_matrices, strict=True
        )
    ]
    terms = [term for term in terms if _is_sound(term)]
    without = tuple(sorted(set(numbers) - {term.number for term in terms}))
    return MissionTerms(platform, parameters, in_order_of_time(terms), without, labels)


def in_order_of_time(terms: Iterable[ProfileTerm]) -> tuple[ProfileTerm, ...]:
    """Return the terms of profiles in the order of time."""
    return tuple(sorted(terms, key=lambda term: term.time))


def _is_sound(term: ProfileTerm) -> bool:
    return all(semidefinite(matrix) for matrix in (term.information, *(matrix for _, matrix in term.others)))


def agreeing_terms(
    archive: Archive, mission: MissionTerms, *, robust: bool
) -> tuple[MissionTerms, DepthRateCheck | None]:
    """Compare the sum of the profiles with the depth rate of their steady glides; state a divisor if the two differ.

    Without enough steady glides there is no comparison, and the mission is returned as it is. Otherwise it contains the
    sum.
    """
    glides = read_glides(archive, [term.number for term in mission.terms], mission.platform)
    if glides is None:
        return mission, None
    undivided = _sum_of_terms(mission, robust=robust)
    check = check_hull(glides, mission.platform, mission.parameters, mission.terms, undivided, robust=robust)
    return replace(mission, divisor=1.0 if check is None else check.divisor, undivided=undivided), check


def _sum_of_terms(mission: MissionTerms, *, robust: bool) -> MissionHull:
    """Sum of the profiles' undivided information."""
    with threadpool_limits(limits=1):
        return solve_mission(mission.terms, mission.prior, robust=robust)


def prepare(request: Request, archive: Archive, _: tuple[int, ...], settings: HullSettings) -> Preparation:
    """Read the profiles; a quick study uses all of them too, since the sum is fast.

    Raises
    ------
    InputError
        No profile has information on the hull.
    """
    numbers = chosen_profiles(archive, request.profiles)
    mission = read_terms(archive, numbers)
    if not mission.terms:
        raise InputError(
            f"{NAME}: none of the {counted(len(numbers), 'profile')} has information on the hull, because the smoother "
            "has no estimate for them, or its filter does not follow them; `gliderhpc info` shows the reasons"
        )
    stated = mission.platform.uncertainty is not None and mission.platform.uncertainty.covariance is not None
    mission, check = agreeing_terms(archive, mission, robust=settings.robust)
    return Preparation(
        inputs=mission,
        numbers=numbers,
        attributes={} if check is None else {"depth_rate_check": asdict(check)},
        remarks=() if check is None or not check.warning else (check.warning,),
        caveats=(MODEL_ERRORS, *((CALIBRATED,) if stated else ())),
    )


def mission_hull(plan: Plan, _: Mapping[int, Row]) -> GroupContent:
    """Sum up the profiles' information, and search for changes of the parameters that can change."""
    mission: MissionTerms = plan.prepared.inputs
    settings: HullSettings = plan.settings
    hull, changes, joint = combine_terms(mission, settings)
    rows: dict[int, Row] = {
        number: {"message": "the smoother has no estimate of this profile, or no information on the hull from it"}
        for number in mission.without
    }
    rows |= {term.number: _profile_row(mission, hull, index) for index, term in enumerate(mission.terms)}
    keys = [mission.parameters[i].key for i in mission.suspects]
    return GroupContent(
        labels={SUSPECT: keys},
        variables=_stored_changes(mission, hull, changes),
        attributes={
            "inflation": hull.inflation,
            "log_evidence": hull.log_evidence,
            **({} if joint is None else {JOINT: joint_in_units(mission, hull, joint)}),
        },
        rows=rows,
    )


def combine_terms(
    mission: MissionTerms, settings: HullSettings
) -> tuple[MissionHull, dict[int, ErrorChange | None], JointChange | None]:
    """Return the sum over the profiles, the changes of the parameters that may change, by position, and that of any.

    Where changes are probable, the sum is repeated with a prior that allows them. Otherwise it would be a mean of the
    hulls before and after. The search for changes uses the undivided information of the profiles: the error for which
    it is otherwise divided is the same in every profile, and cancels in the differences between profiles.
    """
    hull = mission.undivided or _sum_of_terms(mission, robust=settings.robust)
    with threadpool_limits(limits=1):
        changes, joint = find_hull_changes(
            mission.terms, mission.suspects, mission.prior, settings.change, mission.companions, robust=settings.robust
        )
        probable = {i: c for i, c in changes.items() if c is not None and c.probability >= PROBABLE}
        if not probable and joint is not None and joint.probability >= PROBABLE:
            probable = _changed_together(joint, settings.change)
        if probable or mission.divisor > 1.0:
            terms = [term.weakened(mission.divisor) for term in mission.terms]
            hull = solve_mission(terms, _with_changes(mission, probable, settings), robust=settings.robust)
    return hull, changes, joint


_MIN_INCLUDED = 0.1
"""Probability above which a parameter is allowed to change with the others, given that any of them changes."""


def _changed_together(joint: JointChange, size: float) -> dict[int, ErrorChange]:
    """Return a change of each parameter that may be among those that changed; its size is known for some of them."""
    sizes = dict(zip(joint.combination, zip(joint.total, joint.total_std, strict=True), strict=True))
    return {
        i: ErrorChange(joint.probability, *sizes.get(i, (0.0, size)), joint.onset, joint.step_probability)
        for i, included in joint.included.items()
        if included >= _MIN_INCLUDED
    }


def _with_changes(mission: MissionTerms, changes: Mapping[int, ErrorChange], settings: HullSettings) -> HullPrior:
    """Return the prior of a mission in which parameters change, abruptly near the onset or gradually from it."""
    walk = mission.prior.walk.copy()
    jumps: dict[int, Array] = {}
    for parameter, change in changes.items():
        first, onset, last = change.onset
        size = float(np.hypot(change.total, change.total_std))
        companion = mission.companions.get(parameter)
        if change.step_probability < 0.5:
            days = (mission.terms[-1].time - mission.terms[onset - 1].time) / np.timedelta64(1, "D")
            allowed = {parameter: size} if companion is None else {parameter: size, companion: settings.change}
            for index, change_std in allowed.items() if days > 0.0 else ():
                walk[index] = max(walk[index], change_std / np.sqrt(days))
            continue
        for position in range(first, last + 1):
            variance = jumps.setdefault(position, np.zeros(len(walk)))
            variance[parameter] = size**2
            if companion is not None:
                variance[companion] = settings.change**2
    return HullPrior(mission.prior.eta, walk, jumps)


def _profile_row(mission: MissionTerms, hull: MissionHull, index: int) -> Row:
    """Return the row of one profile, in the platform file's units."""
    smoothed, sequential = hull.smoothed[index], hull.sequential[index]
    moved, moved_std = _in_units(mission, smoothed.mean, smoothed.std)
    then, then_std = _in_units(mission, sequential.mean, sequential.std)
    first, _ = _in_units(mission, hull.smoothed[0].mean, smoothed.std)
    can_change = np.isin(np.arange(len(moved)), mission.suspects)
    _, change_std = _in_units(mission, smoothed.mean, hull.change_std[index])
    keys = [p.key for p in mission.parameters]
    columns = {
        "estimate": moved,
        "estimate_std": moved_std,
        "estimate_sequential": then,
        "estimate_sequential_std": then_std,
        "change": np.where(can_change, moved - first, np.nan),
        "change_std": np.where(can_change, change_std, np.nan),
    }
    return {
        **{name: among_parameters(values, keys, mission.labels) for name, values in columns.items()},
        "chi_square": float(hull.chi_square[index]),
        "freedom": float(hull.freedom[index]),
        "weight": float(hull.weight[index]),
    }


def _in_units(mission: MissionTerms, eta: Array, deviation: Array) -> tuple[Array, Array]:
    """Values (p,) and deviations (p,) in the platform file's units."""
    hull = mission.platform
    values = [p.moved(hull, x) for p, x in zip(mission.parameters, eta.tolist(), strict=True)]
    slopes = [abs(p.slope(hull, x)) for p, x in zip(mission.parameters, eta.tolist(), strict=True)]
    return np.array(values), deviation * np.array(slopes)


def _stored_changes(
    mission: MissionTerms, hull: MissionHull, changes: Mapping[int, ErrorChange | None]
) -> dict[str, Array]:
    """Return the variables of the parameters that may change; NaN if there are too few profiles."""
    return {
        name: np.array([np.nan if change is None else change_in_units(mission, hull, i, change)[name]
                        for i, change in changes.items()])
        for name in CHANGE_COLUMNS
    }  # fmt: skip


CHANGE_COLUMNS = (
    "change_probability", "change_total", "change_total_std", "onset", "onset_low", "onset_high", "step_probability",
)  # fmt: skip
"""Variables of the parameters that may change."""


def change_in_units(mission: MissionTerms, hull: MissionHull, parameter: int, change: ErrorChange) -> dict[str, float]:
    """Return `CHANGE_COLUMNS` of a change, with sizes in the platform file's units and onsets as profile numbers."""
    changed = mission.parameters[parameter]
    slope = changed.slope(mission.platform, float(hull.smoothed[0].mean[parameter]))
    low, middle, high = (float(mission.terms[index].number) for index in change.onset)
    values = (
        change.probability, slope * change.total, abs(slope) * change.total_std, middle, low, high,
        change.step_probability,
    )  # fmt: skip
    return dict(zip(CHANGE_COLUMNS, values, strict=True))


def joint_in_units(mission: MissionTerms, hull: MissionHull, joint: JointChange) -> dict[str, Any]:
    """Return the change of any parameter for attribute `JOINT`: sizes in the file's units, onsets as profile numbers.

    Its ``parts`` are the parameters that may change, the most probable first; those of the most probable combination
    have a ``change``.
    """
    low, middle, high = (mission.terms[index].number for index in joint.onset)
    sizes = dict(zip(joint.combination, zip(joint.total, joint.total_std, strict=True), strict=True))
    parts = []
    for i, included in sorted(joint.included.items(), key=lambda item: -item[1]):
        slope = mission.parameters[i].slope(mission.platform, float(hull.smoothed[0].mean[i]))
        part: dict[str, Any] = {"parameter": mission.parameters[i].key, "included": included}
        if i in sizes:
            part |= {"change": slope * sizes[i][0], "change_std": abs(slope) * sizes[i][1]}
        parts.append(part)
    return {
        "probability": joint.probability,
        "onset": middle,
        "onset_low": low,
        "onset_high": high,
        "step_probability": joint.step_probability,
        "combination_probability": joint.combination_probability,
        "parts": parts,
    }


def has_statements(archive: Archive) -> bool:
    """Return whether an archive contains all of the dives' information on the hull that the sum uses.

    Archives of earlier versions have only a part of it, or none.
    """
    return NAME in archive.children and set(STATEMENTS) <= set(archive[NAME].to_dataset().variables)


def missing_input(request: Request, _: object) -> str | None:
    """Require a finished profile that the smoother has estimated."""
    with open_for_reading(request.archive) as archive:
        done = done_profiles(archive)
        if not has_statements(archive):
            return "the archive was made without the smoother's information on the hull; run the mission again"
        numbers = select_profiles(done, request.profiles) if done else []
    return None if numbers else "no profile is finished"


STUDY = Study(
    NAME,
    "hull and sensors estimated from the dives: drag, lift, buoyancy and trim with intervals, and their changes",
    mission=mission_hull,
    settings=HullSettings,
    missing=missing_input,
    prepare=prepare,
    mission_columns=("elapsed_days",),
    estimate_unused="this study sums the smoother's information; `estimate` has no effect",
)
