"""Request of a study: archive, profiles, estimate, inputs and settings, and the folder of the study's files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gliderhpc.archive.profile import ADJOINT
from gliderhpc.mission.executors import Executor
from gliderhpc.mission.settings import SettingsModel, build_settings_of, parse_assignments


@dataclass(frozen=True)
class Request:
    """A study to run on an archive.

    Attributes
    ----------
    archive : Path
        The finished mission.
    executor : callable
        Opens the executor of the jobs.
    profiles : str, optional
        Which profiles, as ``18:20,68``; all that are done when None.
    quick : bool
        Use a reduced size for a first look, under two minutes on two cores.
    estimate : str
        Estimate of disturbances and motion, one of `gliderhpc.archive.profile.ESTIMATES`.
    observations, truth : Path, optional
        The mission's observation file, and a synthetic mission's truth.
    budget : Path, optional
        Uncertainty of the current that ``twin recoverability`` found for the platform.
    reference : Path, optional
        Independent currents for the same dives.
    assignments : tuple of str
        Settings of the study, as ``KEY=VALUE``.
    models : tuple of str
        Files, patterns of files and OPeNDAP addresses of ocean models.
    report : callable
        Called with the number of a profile when it is done.
    """

    archive: Path
    executor: Callable[[], AbstractContextManager[Executor]]
    profiles: str | None = None
    quick: bool = False
    estimate: str = ADJOINT
    observations: Path | None = None
    truth: Path | None = None
    budget: Path | None = None
    models: tuple[str, ...] = ()
    reference: Path | None = None
    assignments: tuple[str, ...] = ()
    report: Callable[[int], None] = lambda _: None

    @property
    def path(self) -> str:
        """The archive's place, for workers that start elsewhere."""
        return str(self.archive.resolve())


def default_folder(archive: str | Path, study: str, estimate: str = ADJOINT) -> Path:
    """Return the default folder of a study's files: ``ARCHIVE-studies/STUDY`` next to ``ARCHIVE.zarr``.

    Files of any estimate but the adjoint's go to ``STUDY-ESTIMATE``.
    """
    path = Path(archive)
    return path.with_name(f"{path.stem}-studies") / (study if estimate == ADJOINT else f"{study}-{estimate}")


def own_assignments(request: Request, name: str) -> dict[str, str]:
    """Settings given for a study, without its name: ``currents.bin=5`` is ``bin`` of the study ``currents``."""
    values, _ = parse_assignments(request.assignments)
    return {key.removeprefix(f"{name}."): text for key, text in values.items() if key.startswith(f"{name}.")}


def own_settings(
    request: Request, name: str, model: type[SettingsModel], base: Mapping[str, Any] | None = None
) -> SettingsModel:
    """Build the settings of a study from defaults and the request's assignments, which take precedence.

    Raises
    ------
    InputError
        A setting is wrong.
    """
    return build_settings_of(model, base or {}, own_assignments(request, name))
