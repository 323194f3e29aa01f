"""Request of a study: archive, profiles, estimate, inputs and settings, and the folder of the study's files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gliderhpc.archive.mission import check_is_path
from gliderhpc.archive.profile import ADJOINT
from gliderhpc.errors import InputError
from gliderhpc.mission.executors import OpenExecutor
from gliderhpc.mission.settings import MissionSettings, SettingsModel, build_settings_of, parse_assignments
from gliderhpc.observations import Observations
from gliderhpc.platform import Platform
from gliderhpc.store_schema.location import is_address


@dataclass(frozen=True, eq=False)
class Simulation:
    """Inputs of a simulation of the records, for the study ``validation``.

    Attributes
    ----------
    observations : Observations
        The open file that the archive was made from.
    platform, settings : Platform, MissionSettings
        Hull to validate, which may differ from the archive's, and settings, whose step and output interval must equal
        the archive's.
    """

    observations: Observations
    platform: Platform
    settings: MissionSettings


@dataclass(frozen=True)
class Request:
    """A study to run on an archive.

    Attributes
    ----------
    archive : Path
        Archive of the mission.
    executor : callable
        Context manager that opens the executor of the jobs.
    profiles : str, optional
        Profiles to study, such as ``18:20,68``; by default all finished ones.
    quick : bool
        True for a first look of reduced size, which takes less than two minutes on two cores.
    estimate : str
        Estimate of disturbances and motion, one of `gliderhpc.archive.profile.ESTIMATES`.
    observations, truth : Path, optional
        Observation file of the mission, and truth of a synthetic mission.
    budget : Path, optional
        Uncertainty of the current that ``twin recoverability`` measured for the platform.
    reference : Path, optional
        Independent currents for the same dives.
    assignments : tuple of str
        Settings of the study, as ``KEY=VALUE``.
    models : tuple of str
        Files, patterns of files and OPeNDAP addresses of ocean models.
    simulation : Simulation, optional
        Records to simulate, with hull and settings.
    on_profile : callable
        Function called with the number of each finished profile.
    """

    archive: Path
    executor: OpenExecutor
    profiles: str | None = None
    quick: bool = False
    estimate: str = ADJOINT
    observations: Path | None = None
    truth: Path | None = None
    budget: Path | None = None
    models: tuple[str, ...] = ()
    reference: Path | None = None
    assignments: tuple[str, ...] = ()
    simulation: Simulation | None = None
    on_profile: Callable[[int], None] = lambda _: None

    @property
    def path(self) -> str:
        """Absolute path of the archive, for workers that start in another folder."""
        return str(self.archive.resolve())

    def options(self, study: str) -> list[str]:
        """Return the words of a command line for the profiles, settings and files of a study, without their folders."""
        files = {"observations": self.observations, "truth": self.truth, "budget": self.budget}
        files["reference"] = self.reference
        words = [] if self.profiles is None else ["--profiles", self.profiles]
        words += [word for name, path in files.items() if path is not None for word in (f"--{name}", path.name)]
        settings = study_assignments(self, study)
        return words + [word for key, text in settings.items() for word in ("--set", f"{study}.{key}={text}")]


def archive_on_disk(store: str | Path) -> Path:
    """Return the path of an archive to study.

    Raises
    ------
    InputError
        The place is an address in an object store, or not a path.
    """
    check_is_path(store)
    if is_address(store):
        raise InputError(f"{store}: studies require the archive on a local disk; copy it from the object store first")
    path = Path(store)
    # `.` and `..` have no name, from which the folder of the results is named.
    return path if path.stem.strip(".") else path.resolve()


def default_folder(archive: str | Path, study: str, estimate: str = ADJOINT) -> Path:
    """Return the default folder of a study's files: ``ARCHIVE-studies/STUDY`` next to ``ARCHIVE.zarr``.

    Files of any estimate but the adjoint's go to ``STUDY-ESTIMATE``.
    """
    path = Path(archive)
    return path.with_name(f"{path.stem}-studies") / (study if estimate == ADJOINT else f"{study}-{estimate}")


def study_assignments(request: Request, name: str) -> dict[str, str]:
    """Return the settings given for a study, without its name: ``currents.bin=5`` is ``bin`` of study ``currents``."""
    values, _ = parse_assignments(request.assignments)
    return {key.removeprefix(f"{name}."): text for key, text in values.items() if key.startswith(f"{name}.")}


def study_settings(
    request: Request, name: str, model: type[SettingsModel], base: Mapping[str, Any] | None = None
) -> SettingsModel:
    """Build the settings of a study from defaults and the request's assignments, which take precedence.

    Raises
    ------
    InputError
        A setting is wrong.
    """
    return build_settings_of(model, base or {}, study_assignments(request, name))
