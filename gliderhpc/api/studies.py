"""Studies of a finished mission, the validation of the forward model, and the drawing of a profile."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import xarray as xr

from gliderhpc.api.arguments import (
    HullArgument,
    Profiles,
    assignments_of,
    chosen_profile,
    platform_of,
    profiles_text,
    settings_of,
)
from gliderhpc.api.workers import Scheduler, cluster_of, executor_of
from gliderhpc.archive.mission import archive_errors, open_for_reading
from gliderhpc.archive.profile import ADJOINT, ESTIMATES, done_profiles
from gliderhpc.errors import InputError
from gliderhpc.findings.comparison import COLUMNS
from gliderhpc.findings.results import Findings, as_plain, write_findings
from gliderhpc.mission.lock import locked
from gliderhpc.mission.settings import MissionSettings, validated_settings
from gliderhpc.observations.in_memory import Records, opened_records
from gliderhpc.observations.truth import read_profile_truth
from gliderhpc.report.motion_figure import motion_figure
from gliderhpc.report.studies import show_study
from gliderhpc.store_schema import read_attributes, restored_on_error, set_study_attributes
from gliderhpc.studies.registry import STUDIES, VALIDATION, run_study
from gliderhpc.studies.request import Request, Simulation, archive_on_disk

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class StudyFindings:
    """Findings of a study.

    Attributes
    ----------
    study : str
        Name of the study and of its group in the archive.
    findings : Findings
        Tables, figures, comparisons and remarks, as the command prints and writes them.
    """

    study: str
    findings: Findings

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """Tables by name."""
        return {stem: pd.DataFrame(list(rows)) for stem, rows in self.findings.tables.items()}

    @property
    def figures(self) -> Mapping[str, "Figure"]:
        """Figures by name."""
        return self.findings.figures

    @property
    def comparisons(self) -> pd.DataFrame:
        """Values of the paper and ours, one row each: quantity, unit, paper, ours, spread, ratio and a remark.

        A range is a tuple of its ends; missing values are None.
        """
        rows = [row for table in self.findings.comparisons.values() for row in table]
        return pd.DataFrame(
            [[row.quantity, row.unit, row.paper, row.ours, row.spread, row.ratio, row.remark] for row in rows],
            columns=list(COLUMNS),
        )

    @property
    def captions(self) -> Mapping[str, str]:
        """Captions by name of figure or table: method, data and uncertainty."""
        return self.findings.captions

    @property
    def remarks(self) -> Sequence[str]:
        """Remarks, such as a note on an input that was not supplied."""
        return self.findings.remarks

    @property
    def failed(self) -> Mapping[int, str]:
        """Profiles that could not be studied, with the reason."""
        return self.findings.failed

    def save(self, folder: str | Path) -> list[Path]:
        """Write tables as CSV, figures as PNG and all numbers as JSON, as the command does.

        Raises
        ------
        InputError
            The folder cannot be written.
        """
        return write_findings(self.findings, self.study, folder)


def analyze_archive(name: str, request: Request) -> Findings:
    """Run one study; if it fails, the group of an earlier run remains unchanged.

    Parameters
    ----------
    name : str
        Name of the study, in `gliderhpc.studies.registry.ALL_STUDIES`.
    request : Request
        Archive, workers, estimate, profiles and inputs.

    Returns
    -------
    Findings
        Tables, figures and comparisons; facts and comparisons are also stored with the study's group.

    Raises
    ------
    InputError
        The study is unknown, or the request lacks one of its inputs.
    """
    with restored_on_error(request.archive, name):
        run_study(name, request)
        return _findings(name, request.archive)


def _findings(name: str, store: str | Path) -> Findings:
    """Make a study's findings, and store their facts and comparisons as attributes of its group."""
    with open_for_reading(store) as archive:
        findings = show_study(name, archive)
    attributes = {**findings.content["facts"], "comparisons": findings.content["comparisons"]}
    set_study_attributes(store, name, as_plain(attributes))
    return findings


def analyze(
    store: str | Path,
    study: str,
    *,
    profiles: Profiles = None,
    quick: bool = False,
    estimate: str = ADJOINT,
    observations: str | Path | None = None,
    truth: str | Path | None = None,
    budget: str | Path | None = None,
    models: str | Path | Sequence[str | Path] = (),
    reference: str | Path | None = None,
    workers: int | None = None,
    scheduler: Scheduler = None,
    **named: Any,
) -> StudyFindings:
    """Run a study of a finished mission, and write its results into the archive's group of that name.

    Parameters
    ----------
    store : str or Path
        The archive.
    study : str
        ``"reconstruction"``, ``"spectra"``, ``"intermittency"``, ``"nulls"``, ``"events"``, ``"currents"``,
        ``"reanalysis"``, ``"vertical"``, ``"hull"`` or ``"drift"``.
    profiles : int, iterable of int, or str, optional
        Profiles to study; by default all that are done.
    quick : bool
        Use a reduced size, for a first look.
    estimate : str
        Estimate of disturbances and motion to study: ``"adjoint"`` or ``"smoothed"``.
    observations, truth, budget, reference : str or Path, optional
        Inputs of some studies, as ``gliderhpc analyze --help`` describes them.
    models : str, Path or sequence of these
        Files, patterns of files and OPeNDAP addresses of ocean models, for ``"reanalysis"``.
    workers : int, optional
        Number of worker processes, 0 to compute in this process; by default one per core.
    scheduler : str or Path, optional
        Address of a running Dask cluster's scheduler, or the file that it wrote.
    **named
        Settings of the study by name, such as ``drag_increase=0.3`` for ``"drift"``.

    Returns
    -------
    StudyFindings
        Findings, with ``.tables``, ``.figures``, ``.comparisons``, ``.captions``, ``.remarks``, ``.failed`` and
        ``.save(folder)``.

    Raises
    ------
    InputError
        There is no such study, one of its inputs is missing, or an argument cannot be used.
    """
    if study not in STUDIES:
        raise InputError(f"study={study!r}: there is no such study; give one of {', '.join(STUDIES)}")
    if estimate not in ESTIMATES:
        raise InputError(f"estimate={estimate!r}: give one of {', '.join(ESTIMATES)}")
    archive = archive_on_disk(store)
    executor = executor_of(workers, cluster_of(scheduler), (archive,))
    sources = (models,) if isinstance(models, str | Path) else models
    request = Request(
        archive,
        executor,
        profiles=profiles_text(profiles),
        quick=quick,
        estimate=estimate,
        observations=_path(observations),
        truth=_path(truth),
        budget=_path(budget),
        models=tuple(map(str, sources)),
        reference=_path(reference),
        assignments=assignments_of(named, f"{study}."),
    )
    # An unreadable archive is reported before the lock is taken.
    with archive_errors(archive), open_for_reading(archive):
        pass
    with archive_errors(archive), locked(archive):
        return StudyFindings(study, _draw_figures(analyze_archive(study, request)))


def validate(
    records: Records,
    hull: HullArgument,
    store: str | Path,
    *,
    profiles: Profiles = None,
    quick: bool = False,
    workers: int | None = None,
    settings: MissionSettings | None = None,
    **named: Any,
) -> StudyFindings:
    """Simulate every profile open loop with its recorded controls, and compare the result with the record.

    Parameters
    ----------
    records : xarray.Dataset, str or Path
        Observations from which the archive was made.
    hull : Platform, str or Path
        The hull to validate; it may differ from the archive's.
    store : str or Path
        The archive; the comparison is written into its group ``validation``.
    profiles : int, iterable of int, or str, optional
        Profiles of the archive to simulate; all by default.
    quick : bool
        Simulate only a few profiles, for a first look.
    workers : int, optional
        Number of worker processes, 0 to compute in this process; by default one per core.
    settings : MissionSettings, optional
        Settings; those of the archive by default.
    **named
        Settings by name, which override those of `settings` or of the archive.

    Returns
    -------
    StudyFindings
        Findings, with ``.tables``, ``.figures``, ``.comparisons`` and the other attributes that `analyze` returns.

    Raises
    ------
    InputError
        The archive was made from other observations or on other axes, or an argument cannot be used.
    """
    archive, platform, executor = archive_on_disk(store), platform_of(hull), executor_of(workers)
    with archive_errors(archive), open_for_reading(archive):
        if settings is None:
            settings = validated_settings(MissionSettings, read_attributes(archive)["settings"], named)
        else:
            settings = settings_of(MissionSettings, settings, named)
    with archive_errors(archive), locked(archive), opened_records(records) as observations:
        simulation = Simulation(observations, platform, settings)
        request = Request(archive, executor, profiles=profiles_text(profiles), quick=quick, simulation=simulation)
        return StudyFindings(VALIDATION, _draw_figures(analyze_archive(VALIDATION, request)))


def plot_profile(
    dive: xr.DataTree, profile: int | None = None, *, truth: str | Path | xr.Dataset | None = None
) -> "Figure":
    """Draw a profile on one page: attitude and depth, measured and reconstructed, and the six disturbances.

    Parameters
    ----------
    dive : xarray.DataTree
        Profile or mission, as returned by `invert`, `run_mission` or `open_mission`.
    profile : int, optional
        Number of the profile; optional if only one is done.
    truth : str, Path or xarray.Dataset, optional
        Truth of a synthetic mission: its file, or the part for this profile.

    Returns
    -------
    matplotlib.figure.Figure
        Ten axes over time in minutes, labelled ``roll`` ... ``B_cr``; `savefig` writes the figure.

    Raises
    ------
    InputError
        There is no such profile, or it is not done.
    """
    if not isinstance(dive, xr.DataTree) or "series" not in dive.children:
        raise InputError("dive: give what invert, run_mission or open_mission returned")
    if not dive["profile"].ndim:
        raise InputError(
            "dive: a profile selected by sel(profile=2) has no dimension profile; select it by sel(profile=[2]), or "
            "give the whole mission and profile=2"
        )
    number = chosen_profile(done_profiles(dive), profile) if profile is None else profile
    known = read_profile_truth(Path(truth), number) if isinstance(truth, str | Path) else truth
    return motion_figure(dive, number, known)


def plot_currents(found: xr.Dataset | xr.DataTree) -> "Figure":
    """Draw a map of depth-averaged currents: arrow and error ellipse of each dive, fixes, and the track under water.

    Parameters
    ----------
    found : xarray.Dataset or xarray.DataTree
        Currents, as returned by `currents`, `invert`, `run_mission` or `open_mission`. For an archive the smoother's
        current is drawn where it is usable, and otherwise the adjoint's.

    Returns
    -------
    matplotlib.figure.Figure
        Map with undistorted arrows and ellipses of one standard deviation; `savefig` writes it.

    Raises
    ------
    InputError
        No profile has a current.
    """
    from gliderhpc.report.currents_map import currents_map

    if not isinstance(found, xr.Dataset | xr.DataTree):
        raise InputError("found: give what currents, invert, run_mission or open_mission returned")
    return currents_map(found.to_dataset() if isinstance(found, xr.DataTree) else found)


def _draw_figures(findings: Findings) -> Findings:
    """Draw all figures while the archive is locked, since another run of the study may change it afterwards."""
    return replace(findings, figures=dict(findings.figures))


def _path(path: str | Path | None) -> Path | None:
    return None if path is None else Path(path)
