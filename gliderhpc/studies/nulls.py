"""Study ``nulls``: missions without turbulence, processed by the same pipeline (section 5.3).

Each null is a flight simulated with the recorded actuation of a profile. It is sampled by the hull's sensors and
inverted like the mission, and the statistics of the measured profiles are computed for it. Workers process the nulls in
batches, whose members are inverted side by side in the lanes.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field
from threadpoolctl import threadpool_limits

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import SMOOTHED, ProfileData, read_profile_data
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.preparation import PreparedProfile, model_controls, prepare_profile
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profiles
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import RecordSettings, Settings
from gliderhpc.flight.coefficients import coefficients_of, with_errors
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.jobs import batch_size
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.outcomes import Outcome
from gliderhpc.platform import Platform
from gliderhpc.simulator.replay import RecordedActuation, record_of, replay
from gliderhpc.store_schema.columns import COEFFICIENT, FAMILIES, GAUSSIAN, MODEL_ERROR, NOISE_ONLY, NULL, REALISATIONS
from gliderhpc.studies.archived import CONTROLS_SI, platform_of, sample_interval, settings_of, states_of
from gliderhpc.studies.library.turbulence.ensembles import stored_measured
from gliderhpc.studies.library.turbulence.gaussianity import TESTED, gaussianity_row, noise_of_estimate
from gliderhpc.studies.library.turbulence.series import (
    IntermittencySettings,
    averaged_over,
    bridge_gaps,
    bridged_depth,
    channel_of,
    channel_of_estimate,
    fast_part,
    high_passed,
    missing_band,
)
from gliderhpc.studies.library.turbulence.statistics import resolved_structure_functions, statistics_row
from gliderhpc.studies.library.turbulence.surrogates import surrogate_test
from gliderhpc.studies.request import Request, study_settings
from gliderhpc.studies.study import GroupContent, Plan, Preparation, Row, Study
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]

NAME = "nulls"
QUICK_REALISATIONS = 2
QUICK_SURROGATES = 9


class NullSettings(Settings):
    """Number of nulls of each family, and the statistics computed for them."""

    noise_only: int = Field(12, ge=0, description="realisations of the known hull with sensor noise alone")
    model_error: int = Field(12, ge=0, description="realisations of hulls whose coefficients are drawn")
    gaussian: int = Field(12, ge=0, description="realisations with Gaussian disturbances of the measured spectra")
    spread: float = Field(0.15, ge=0, lt=1, description="largest relative error of a coefficient that is drawn")
    seed: int = Field(0, ge=0, description="seed of all draws")
    statistics: IntermittencySettings = IntermittencySettings()

    @property
    def families(self) -> dict[str, int]:
        """Number of realisations of each family."""
        return {NOISE_ONLY: self.noise_only, MODEL_ERROR: self.model_error, GAUSSIAN: self.gaussian}


@dataclass(frozen=True)
class Realisation:
    """One null: position among all nulls, family, seed of its draws, and profile whose actuation it uses."""

    index: int
    family: str
    seed: int
    profile: int

    @property
    def row(self) -> dict[str, Any]:
        """Row of the group's table, before the simulation."""
        return {"family": self.family, "source_profile": self.profile, "realisation_seed": self.seed}


def realisations(settings: NullSettings, profiles: tuple[int, ...]) -> list[Realisation]:
    """Plan all nulls; each family uses the profiles in turn, evenly spread if there are fewer nulls than profiles."""
    planned: list[Realisation] = []
    for family, count in settings.families.items():
        for order in range(count):
            at = order * len(profiles) // count if count < len(profiles) else order % len(profiles)
            index = len(planned)
            planned.append(Realisation(index, family, 1000 * settings.seed + index, profiles[at]))
    return planned


def fly_null(
    archive: Archive,
    null: Realisation,
    platform: Platform,
    mission: MissionSettings,
    settings: NullSettings,
    estimate: str,
) -> tuple[PreparedProfile, Row, Array]:
    """Simulate the flight and the records of one null.

    Returns
    -------
    task : PreparedProfile
        Prepared profile to invert.
    row : dict
        Row of the group's table so far.
    factors : (k,) array
        Factors of the coefficients in the simulation.

    Raises
    ------
    ProfileError
        The flight leaves the model's domain, or its record cannot be used.
    InputError
        No draw of the coefficients glides stably.
    """
    data = read_profile_data(archive, null.profile, estimate)
    actuation, rng = actuation_of(data, platform), np.random.default_rng([null.seed, 1])
    hull = with_errors(platform, settings.spread, null.seed) if null.family == MODEL_ERROR else platform
    times = actuation.times
    seawater = _seawater(data, times)
    bodies = Glider(platform).bodies(model_controls(platform, actuation.at(times), seawater))
    disturbances = np.zeros((len(times), 6))
    if null.family == GAUSSIAN:
        disturbances = gaussian_disturbances(data, platform, settings, times, rng)
    flight = replay(hull, actuation, bodies, disturbances)
    record = record_of(flight, actuation, platform, rng)
    series = on_steps(record, without_corrections(mission))
    series = replace(series, seawater=_seawater(data, series.time[:-1] + 0.5 * series.step))
    row = null.row | {"duration": flight.duration, "max_depth": float(flight.states[:, 5].max())}
    return prepare_profile(Glider(platform), series), row, factors_of(hull, platform)


def without_corrections(mission: MissionSettings) -> MissionSettings:
    """Remove the corrections of records from a mission's settings: an archive's records are already corrected."""
    return mission.model_copy(update={"records": RecordSettings()})


def actuation_of(data: ProfileData, platform: Platform) -> RecordedActuation:
    """Recorded actuation of a profile, first state, and the records at which the sensors were read."""
    interval = float(data.attributes["output_interval"])
    sampled = data.sampled
    if not sampled.any():
        every = max(1, round(sample_interval(data, platform) / interval))
        sampled = np.arange(len(data.record_time)) % every == 0
    return RecordedActuation(
        data.number, data.epoch, interval, states_of(data)[0], data.controls * CONTROLS_SI, sampled
    )


def gaussian_disturbances(
    data: ProfileData, platform: Platform, settings: NullSettings, times: Array, rng: np.random.Generator
) -> Array:
    """Draw Gaussian disturbances ``(n, 6)`` at times (s): in the channel studied, and in sway and roll.

    They have the spectra of the fast parts of the profile's disturbances, and their coherence, as all channels have the
    same random phases.
    """
    statistics, drawn, phases = settings.statistics, np.zeros((len(times), 6)), None
    for name in dict.fromkeys((statistics.channel, *TESTED)):
        series = channel_of(data, name, platform)
        counted = series.counted(actuated=False)
        fast = high_passed(bridge_gaps(series.values, counted), series.step, statistics.cutoff)
        spectrum = scipy.fft.rfft(fast)
        if phases is None:
            phases = np.exp(2j * np.pi * rng.uniform(size=len(spectrum)))
            phases[0] = 1.0
        # The fast part is zero in gaps, to which the phases spread its variance.
        share = max(float(counted.mean()), 1.0 / len(counted))
        random = scipy.fft.irfft(spectrum * phases, len(fast)) / np.sqrt(share)
        drawn[:, list(CHANNELS).index(name)] = np.interp(times, series.time, random)
    return drawn


def factors_of(hull: Platform, platform: Platform) -> Array:
    """True coefficients over the platform's, in the order of `coefficient_names`; NaN where the platform's is zero."""
    true, known = (np.array(list(coefficients_of(flown).values())) for flown in (hull, platform))
    factors: Array = np.divide(true, known, out=np.full_like(true, np.nan), where=known != 0.0)
    return factors


def coefficient_names(platform: Platform) -> list[str]:
    """Names of the coefficients that are drawn."""
    return list(coefficients_of(platform))


def _seawater(data: ProfileData, times: Array) -> Array | None:
    """Seawater ``(n, 4)`` around the glider at times (s); None if buoyancy does not depend on measured density.

    Simulation and inversion of a null both use the seawater that the profile met at each time, even where the simulated
    glider is at another depth.
    """
    if data.seawater is None:
        return None
    columns = np.column_stack([bridged_depth(data), data.seawater])
    return np.column_stack([np.interp(times, data.record_time, column) for column in columns.T])


# A batch of nulls


NullResult = tuple[Realisation, Row, Array | None]
"""A null, its row, and the factors of the coefficients in its simulation; None if it could not be simulated."""


def run_nulls(archive: str, estimate: str, settings: NullSettings, nulls: Sequence[Realisation]) -> list[NullResult]:
    """Simulate some nulls in a worker, invert them side by side in the engine's lanes, and compute their statistics.

    The inversion is that of the mission, with the same settings, engine and platform. Only the corrections of records
    are left out.
    """
    results: list[NullResult] = []
    with threadpool_limits(limits=1), open_for_reading(archive) as opened:
        platform, mission = platform_of(opened), settings_of(opened)

        def tasks() -> Iterator[tuple[tuple[Realisation, Row, Array], PreparedProfile]]:
            for null in nulls:
                try:
                    task, row, factors = fly_null(opened, null, platform, mission, settings, estimate)
                except (ProfileError, InputError) as error:
                    results.append((null, null.row | {"message": str(error)}, None))
                else:
                    yield (null, row, factors), task

        with_hull = estimate == SMOOTHED
        inverted = estimate_profiles(tasks(), without_corrections(mission), with_hull=with_hull)
        for (null, row, factors), inversion in inverted:
            statistics = _inverted_row(inversion, estimate, settings.statistics, null.seed, mission.steps_per_record)
            results.append((null, {**row, **statistics}, factors))
    return results


def _inverted_row(
    inversion: ProfileEstimate | ProfileError, estimate: str, settings: IntermittencySettings, seed: int, every: int
) -> dict[str, Any]:
    """Statistics of a null, and its rank test against surrogates; a null found intermittent is a false positive."""
    if isinstance(inversion, ProfileError):
        return {"message": str(inversion)}
    channel = channel_of_estimate(inversion, settings.channel, estimate, every)
    windows = inversion.solution.windows
    row: dict[str, Any] = {
        "converged_fraction": float(np.mean([window.outcome == Outcome.CONVERGED for window in windows]))
    }
    part = fast_part(channel, settings, actuated=False)
    if part.message:
        return row | {"message": part.message}
    fast = averaged_over(part.series, settings.interval)
    structures = resolved_structure_functions(fast, settings, channel.sample_interval)
    row |= statistics_row(part.series, structures, channel, settings)
    row |= gaussianity_row(noise_of_estimate(inversion, every), settings)
    if not np.isfinite(row["flatness"]):
        return row | {"p_value": float("nan")}
    rng = np.random.default_rng([seed, 2])
    try:
        return row | {"p_value": surrogate_test(fast, settings, channel.sample_interval, rng).p_value}
    except ProfileError as error:
        return row | {"message": str(error)}


# The mission


def prepare(request: Request, archive: Archive, numbers: tuple[int, ...], settings: NullSettings) -> Preparation:
    """Read the mission's settings and the names of the coefficients."""
    return Preparation(inputs=(settings_of(archive), coefficient_names(platform_of(archive))))


def null_missions(plan: Plan, rows: Mapping[int, Row]) -> GroupContent:
    """Simulate and invert nulls of the chosen profiles.

    Raises
    ------
    InputError
        No null is requested.
    """
    mission, names = plan.prepared.inputs
    planned = realisations(plan.settings, plan.numbers)
    if not planned:
        raise InputError("nulls: no realisation is requested; set the number of at least one family above zero")
    results = _run_batches(plan, planned, mission)
    variables: dict[str, Any] = {
        variable.name: [row.get(variable.name, variable.fill_value) for _, row, _ in results]
        for variable in REALISATIONS
    }
    unknown = np.full(len(names), np.nan)
    variables["factor"] = np.array([unknown if factors is None else factors for _, _, factors in results])
    return GroupContent(
        sizes={NULL: len(planned)},
        labels={COEFFICIENT: names},
        variables=variables,
        columns=tuple(dict.fromkeys(name for _, row, _ in results for name in row)),
    )


def _run_batches(plan: Plan, planned: list[Realisation], mission: MissionSettings) -> list[NullResult]:
    """Simulate and invert the nulls in batches; a profile is reported as done with its first null."""
    request, seen, results = plan.request, set[int](), list[NullResult]()
    with request.executor() as executor:
        batches = -(-len(planned) // batch_size(mission, len(planned), executor.workers))
        # Families in every batch, as those with a disturbance take longer.
        jobs = [planned[first::batches] for first in range(batches)]
        for batch in executor.run(partial(run_nulls, request.path, request.estimate, plan.settings), jobs):
            results += batch
            for profile in {null.profile for null, _, _ in batch} - seen:
                seen.add(profile)
                request.on_profile(profile)
    return sorted(results, key=lambda result: result[0].index)


def null_settings(request: Request) -> NullSettings:
    """Return the requested settings; by default the statistics are those of the measured profiles."""
    with open_for_reading(request.archive) as archive:
        _, of_measured = stored_measured(archive, request.estimate)
    base: dict[str, Any] = dict.fromkeys(FAMILIES, QUICK_REALISATIONS) if request.quick else {}
    if of_measured is not None:
        base["statistics"] = of_measured.model_dump()
    elif request.quick:
        base["statistics"] = {"surrogates": QUICK_SURROGATES}
    return study_settings(request, NAME, NullSettings, base)


def missing(request: Request, settings: NullSettings) -> str | None:
    """Return the reason why the sampling rate of the records is too low for this study, or None if it is not."""
    return missing_band(request, settings.statistics)


STUDY = Study(
    NAME,
    "results of the pipeline for missions without turbulence",
    mission=null_missions,
    settings=null_settings,
    missing=missing,
    prepare=prepare,
)
