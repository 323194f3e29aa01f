"""The missions without turbulence: flown under a profile's own actuation, recorded, inverted as the archive was."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData, read_profile_data
from gliderhpc.estimation.preparation import ProfileTask, model_controls, on_steps
from gliderhpc.estimation.settings import RecordSettings
from gliderhpc.flight.coefficients import coefficients_of, with_errors
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import ProfileSeries
from gliderhpc.platform import Platform
from gliderhpc.simulator.replay import Actuation, record_of, replay
from gliderhpc.studies.archived import CONTROLS_SI, sample_interval, states_of
from gliderhpc.studies.library.turbulence.channel import bridged_depth, channel_of
from gliderhpc.studies.library.turbulence.high_pass import bridged, high_passed
from gliderhpc.studies.nulls.settings import NullSettings
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]

GAUSSIAN, MODEL_ERROR = "gaussian", "model_error"


@dataclass(frozen=True)
class Realisation:
    """One null: its place among them, its kind, the number its draws follow from, and the profile it flies as."""

    index: int
    family: str
    seed: int
    profile: int


@dataclass(frozen=True, eq=False)
class Flown:
    """A null that was flown: what is to be inverted, and what is known of it."""

    task: ProfileTask
    row: dict[str, Any]
    factors: Array


def realisations(settings: NullSettings, profiles: tuple[int, ...]) -> list[Realisation]:
    """Plan all nulls; each kind takes the profiles in turn, evenly spread where there are fewer nulls than profiles."""
    planned: list[Realisation] = []
    for family, count in settings.families.items():
        for place in range(count):
            at = place * len(profiles) // count if count < len(profiles) else place % len(profiles)
            index = len(planned)
            planned.append(Realisation(index, family, 1000 * settings.seed + index, profiles[at]))
    return planned


def fly_null(
    archive: xr.DataTree, null: Realisation, platform: Platform, mission: MissionSettings, settings: NullSettings,
    estimate: str,
) -> Flown:  # fmt: skip
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
    hull = platform
    if null.family == MODEL_ERROR:
        hull = with_errors(platform, settings.spread, null.seed)
    times = actuation.times
    seawater = _seawater(data, times)
    bodies = Glider(platform).bodies(model_controls(platform, actuation.at(times), seawater))
    disturbances = np.zeros((len(times), 6))
    if null.family == GAUSSIAN:
        channel = settings.statistics.channel
        disturbances[:, list(CHANNELS).index(channel)] = gaussian_disturbance(data, platform, settings, times, rng)
    flight = replay(hull, actuation, bodies, disturbances)
    record = record_of(flight, actuation, platform, rng)
    series = on_steps(record, uncorrected(mission))
    series = _with_seawater(series, data)
    row = {
        "family": null.family,
        "source_profile": null.profile,
        "realisation_seed": null.seed,
        "duration": flight.duration,
        "max_depth": float(flight.states[:, 5].max()),
    }
    return Flown(ProfileTask(Glider(platform), series), row, factors_of(hull, platform))


def uncorrected(mission: MissionSettings) -> MissionSettings:
    """The mission's settings less its corrections of the records: what an archive holds is corrected already."""
    return mission.model_copy(update={"records": RecordSettings()})


def actuation_of(data: ProfileData, platform: Platform) -> Actuation:
    """Recorded actuation of a profile, the state it began in, and when its sensors were read."""
    interval = float(data.attributes["output_interval"])
    sampled = data.sampled
    if not sampled.any():
        every = max(1, round(sample_interval(data, platform) / interval))
        sampled = np.arange(len(data.record_time)) % every == 0
    return Actuation(data.number, data.epoch, interval, states_of(data)[0], data.controls * CONTROLS_SI, sampled)


def gaussian_disturbance(
    data: ProfileData, platform: Platform, settings: NullSettings, times: Array, rng: np.random.Generator
) -> Array:
    """Gaussian series ``(n,)`` at times with the spectrum of the profile's fast part: its amplitudes, phases drawn."""
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
    """Seawater ``(n, 4)`` at times (s) of a profile whose buoyancy went by density: where it was, not where it is now.

    The null is held by the water that the profile met at that time, in its flight and in its inversion alike.
    """
    if data.seawater is None:
        return None
    columns = np.column_stack([bridged_depth(data), data.seawater])
    return np.column_stack([np.interp(times, data.record_time, column) for column in columns.T])


def _with_seawater(series: ProfileSeries, data: ProfileData) -> ProfileSeries:
    return replace(series, seawater=_seawater(data, series.time[:-1] + 0.5 * series.step))
