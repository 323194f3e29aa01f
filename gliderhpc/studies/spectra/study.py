"""The study over a mission: a job a profile, the archive's group, Table 1 and Figure 4."""

from dataclasses import dataclass

import xarray as xr

from gliderhpc.archive.opening import open_for_reading
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.studies.archived import platform_of
from gliderhpc.studies.library.turbulence.band import missing_band
from gliderhpc.studies.library.turbulence.channel import channel_of, series_step
from gliderhpc.studies.library.turbulence.settings import SpectraSettings
from gliderhpc.studies.profile_jobs import StudiedProfile, study_profiles
from gliderhpc.studies.spectra.groups import groups_by_speed, speeds
from gliderhpc.studies.spectra.profile_spectra import profile_spectra
from gliderhpc.studies.study import Request, Study, begin_study, choose, finish_study_group, own_assignments, provenance

NAME = "spectra"


@dataclass(frozen=True)
class SpectraJob:
    """One profile to study, and what is known of it beforehand."""

    number: int
    index: int
    estimate: str
    settings: SpectraSettings
    speed: float
    group: str


def study_profile(archive: xr.DataTree, job: SpectraJob) -> StudiedProfile:
    """Study one profile: its spectra and row; the job of a worker."""
    data = read_profile_data(archive, job.number, job.estimate)
    found = profile_spectra(channel_of(data, job.settings.channel, platform_of(archive)), job.settings)
    row = {"group": job.group, "speed": job.speed, **found.row}
    return StudiedProfile(job.number, job.index, row, rows=found.on_frequencies)


def run(request: Request) -> None:
    """Study the chosen profiles, into the archive's group ``spectra``.

    Raises
    ------
    InputError
        No such profile is done, the archive has no such estimate, or a setting is wrong.
    """
    settings = _settings(request)
    with open_for_reading(request.archive) as archive:
        chosen = choose(archive, request)
        speed = speeds(archive, chosen.numbers, request.estimate)
        step = series_step(archive, request.estimate)
    groups = groups_by_speed(speed, settings.groups)
    jobs = [
        SpectraJob(number, chosen.where[number], request.estimate, settings, speed[number], groups[number])
        for number in chosen.numbers
    ]
    frequencies = max(2, round(settings.segment / step)) // 2 + 1
    remarks = chosen.remarks + begin_study(request, NAME, {"frequency": frequencies})
    rows = {result.number: result.row for result in study_profiles(request, NAME, study_profile, jobs)}
    made = provenance(request, rows, settings.model_dump(mode="json"), remarks)
    finish_study_group(request.archive, NAME, made)


def _settings(request: Request) -> SpectraSettings:
    return build_settings_of(SpectraSettings, {}, own_assignments(request, NAME))


def missing(request: Request) -> str | None:
    """Say why the records are sampled too rarely for this study, None where they are not."""
    return missing_band(request, _settings(request))


STUDY = Study(NAME, "spectra of a disturbance's fast part and their exponents", missing, run)
"""What the registry finds."""
