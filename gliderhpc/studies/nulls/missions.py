"""Missions without turbulence, flown under a profile's recorded actuation and recorded by the hull's sensors."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field

from gliderhpc.archive.profile import ProfileData, read_profile_data
from gliderhpc.estimation.preparation import ProfileTask, model_controls, on_steps
from gliderhpc.estimation.settings import RecordSettings, Settings
from gliderhpc.flight.coefficients import coefficients_of, with_errors
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import ProfileSeries
from gliderhpc.platform import Platform
from gliderhpc.simulator.replay import Actuation, record_of, replay
from gliderhpc.store_schema.studies.nulls import GAUSSIAN, MODEL_ERROR, NOISE_ONLY
from gliderhpc.studies.archived import CONTROLS_SI, sample_interval, states_of
from gliderhpc.studies.library.turbulence.series import bridged, bridged_depth, channel_of, high_passed
from gliderhpc.studies.library.turbulence.settings import IntermittencySettings
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]


class NullSettings(Settings):
    """Number of nulls of each family, and the statistics that they are judged by."""

    noise_only: int = Field(12, ge=0, description="realisations of the known hull with sensor noise alone")
    model_error: int = Field(12, ge=0, description="realisations of hulls whose coefficients are drawn")
    gaussian: int = Field(12, ge=0, description="realisations with a Gaussian disturbance of the measured spectrum")
    spread: float = Field(0.15, ge=0, lt=1, description="largest relative error of a coefficient that is drawn")
    seed: int = Field(0, ge=0, description="of all draws")
    statistics: IntermittencySettings = IntermittencySettings()

    @property
    def families(self) -> dict[str, int]:
        """Realisations of each family."""
        return {NOISE_ONLY: self.noise_only, MODEL_ERROR: self.model_error, GAUSSIAN: self.gaussian}


@dataclass(frozen=True)
class Realisation:
    """One null: its place among them, its family, the seed of its draws, and the profile that it flies as."""

    index: int
    family: str
    seed: int
    profile: int


@dataclass(frozen=True, eq=False)
class FlownNull:
    """A null that was flown: the task of its inversion, its row so far, and the factors on its coefficients."""

    task: ProfileTask
    row: dict[str, Any]
    factors: Array


def realisations(settings: NullSettings, profiles: tuple[int, ...]) -> list[Realisation]:
    """Plan all nulls; a family takes the profiles in turn, evenly spread where there are fewer nulls than profiles."""
    planned: list[Realisation] = []
    for family, count in settings.families.items():
        for place in range(count):
            at = place * len(profiles) // count if count < len(profiles) else place % len(profiles)
            index = len(planned)
            planned.append(Realisation(index, family, 1000 * settings.seed + index, profiles[at]))
    return planned


def fly_null(
    archive: xr.DataTree,
    null: Realisation,
    platform: Platform,
    mission: MissionSettings,
    settings: NullSettings,
    estimate: str,
) -> FlownNull:
    """Fly and record one null.

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
        channel = settings.statistics.channel
        disturbances[:, list(CHANNELS).index(channel)] = gaussian_disturbance(data, platform, settings, times, rng)
    flight = replay(hull, actuation, bodies, disturbances)
    record = record_of(flight, actuation, platform, rng)
    series = _with_seawater(on_steps(record, without_corrections(mission)), data)
    row = {
        "family": null.family,
        "source_profile": null.profile,
        "realisation_seed": null.seed,
        "duration": flight.duration,
        "max_depth": float(flight.states[:, 5].max()),
    }
    return FlownNull(ProfileTask(Glider(platform), series), row, factors_of(hull, platform))


def without_corrections(mission: MissionSettings) -> MissionSettings:
    """Drop a mission's corrections of the records from its settings: an archive's records are corrected already."""
    return mission.model_copy(update={"records": RecordSettings()})


def actuation_of(data: ProfileData, platform: Platform) -> Actuation:
    """Recorded actuation of a profile, its first state, and the records at which its sensors were read."""
    interval = float(data.attributes["output_interval"])
    sampled = data.sampled
    if not sampled.any():
        every = max(1, round(sample_interval(data, platform) / interval))
        sampled = np.arange(len(data.record_time)) % every == 0
    return Actuation(data.number, data.epoch, interval, states_of(data)[0], data.controls * CONTROLS_SI, sampled)


def gaussian_disturbance(
    data: ProfileData, platform: Platform, settings: NullSettings, times: Array, rng: np.random.Generator
) -> Array:
    """Draw a Gaussian series ``(n,)`` at times (s): the amplitudes of the profile's fast part with random phases."""
    statistics = settings.statistics
    series = channel_of(data, statistics.channel, platform)
    counted = series.counted(actuated=False)
    fast = high_passed(bridged(series.values, counted), series.step, statistics.cutoff)
    spectrum = scipy.fft.rfft(fast)
    phases = np.exp(2j * np.pi * rng.uniform(size=len(spectrum)))
    phases[0] = 1.0
    drawn = scipy.fft.irfft(np.abs(spectrum) * phases, len(fast))
    return np.interp(times, series.time, drawn)


def factors_of(hull: Platform, platform: Platform) -> Array:
    """True coefficients over the platform's, in the order of `coefficient_names`; NaN where the platform has none."""
    true, known = (np.array(list(coefficients_of(one).values())) for one in (hull, platform))
    factors: Array = np.divide(true, known, out=np.full_like(true, np.nan), where=known != 0.0)
    return factors


def coefficient_names(platform: Platform) -> list[str]:
    """Names of the coefficients that are drawn."""
    return list(coefficients_of(platform))


def _seawater(data: ProfileData, times: Array) -> Array | None:
    """Seawater ``(n, 4)`` that a profile met at times (s), None where its buoyancy is not by density.

    Flight and inversion of a null both take the water of that time, wherever the null is then.
    """
    if data.seawater is None:
        return None
    columns = np.column_stack([bridged_depth(data), data.seawater])
    return np.column_stack([np.interp(times, data.record_time, column) for column in columns.T])


def _with_seawater(series: ProfileSeries, data: ProfileData) -> ProfileSeries:
    return replace(series, seawater=_seawater(data, series.time[:-1] + 0.5 * series.step))
