"""``gliderhpc analyze`` and ``validate``: studies of a finished mission, and comparison of model and records."""

from collections.abc import Iterator
from pathlib import Path

import click

from gliderhpc.api.studies import analyze_archive
from gliderhpc.archive.mission import archive_errors, open_for_reading
from gliderhpc.archive.profile import ADJOINT, ESTIMATES
from gliderhpc.cli import options
from gliderhpc.cli.console import logging_to, progress, results
from gliderhpc.cli.messages import Verb, echo, print_left_out
from gliderhpc.cli.options import executor_for
from gliderhpc.errors import InputError
from gliderhpc.findings.comparison import comparison_table
from gliderhpc.findings.results import Findings, write_findings
from gliderhpc.flight.glider import load_platform
from gliderhpc.mission.cluster import ClusterAddress
from gliderhpc.mission.lock import locked
from gliderhpc.mission.settings import build_settings, parse_assignments
from gliderhpc.observations import open_observations
from gliderhpc.output_files import check_folder
from gliderhpc.store_schema import read_attributes
from gliderhpc.store_schema.location import Location
from gliderhpc.studies.archived import QUICK_PROFILES, chosen_profiles
from gliderhpc.studies.registry import STUDIES, VALIDATION, load_study, missing_input
from gliderhpc.studies.request import Request, Simulation, archive_on_disk, default_folder

ALL = "all"


@click.command("analyze", cls=Verb)
@click.argument("archive", metavar="ARCHIVE", type=options.PLACE)
@click.argument("study", metavar="STUDY", type=options.Choice([*STUDIES, ALL]))
@options.profiles
@click.option("--quick", is_flag=True, help="A reduced size, for a first look.")
@click.option(
    "--estimate",
    type=options.Choice(ESTIMATES),
    default=ADJOINT,
    show_default=True,
    help="Estimate of disturbances and motion to study: that of the windows or of the smoother.",
)
@click.option(
    "--observations", type=click.Path(path_type=Path), help="The observation file, for studies that invert again."
)
@click.option("--truth", type=click.Path(path_type=Path), help="Truth file of a synthetic mission.")
@click.option(
    "--budget",
    type=click.Path(path_type=Path),
    help="For currents: budget from `twin recoverability` or `twin currents`.",
)
@click.option(
    "--model",
    "models",
    multiple=True,
    metavar="FILE_OR_URL",
    help="For reanalysis: a file, quoted pattern or OPeNDAP address of an ocean model; repeatable.",
)
@click.option(
    "--reference",
    type=click.Path(path_type=Path),
    help="For currents: a current profiler's file, or an imported one with the operator's currents.",
)
@options.study_assignments
@options.workers
@options.cluster
@options.study_folder
@options.log_file
def analyze(
    archive: Location,
    study: str,
    profiles: str | None,
    quick: bool,
    estimate: str,
    observations: Path | None,
    truth: Path | None,
    budget: Path | None,
    models: tuple[str, ...],
    reference: Path | None,
    assignments: tuple[str, ...],
    workers: int | None,
    cluster: ClusterAddress | None,
    out: Path | None,
    log_file: Path | None,
) -> int:
    """Run STUDY on a finished mission, or with `all` every study whose inputs are available.

    STUDY is one of reconstruction, currents, reanalysis, vertical, spectra, intermittency, nulls, events, hull, drift.
    The results go into the archive's group with the name of the study, and into CSV, PNG and JSON files. The paper's
    values are printed next to these.

    \b
    Examples:
      gliderhpc analyze mission.zarr reconstruction
      gliderhpc analyze mission.zarr reconstruction --estimate smoothed
      gliderhpc analyze mission.zarr vertical
      gliderhpc analyze mission.zarr reconstruction --profiles 18:20 --observations mission.nc
      gliderhpc analyze twin.zarr reconstruction --observations twin.nc --truth twin.truth.nc
      gliderhpc analyze mission.zarr currents --budget budget.yaml --set currents.bin=5
      gliderhpc analyze mission.zarr currents --reference adcp.nc
      gliderhpc analyze mission.zarr drift --set drift.drag_increase=0.3
      gliderhpc analyze mission.zarr reanalysis --model hycom.nc --model glorys.nc
      gliderhpc analyze mission.zarr spectra --profiles 18:20,68:70,118:120 --set spectra.shallowest=200
      gliderhpc analyze mission.zarr intermittency --set intermittency.scaling=[2,20]
      gliderhpc analyze mission.zarr nulls --quick
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    archive = archive_on_disk(archive)
    with archive_errors(archive), open_for_reading(archive) as opened:
        count = len(chosen_profiles(opened, profiles, quick))
    status = 0
    with logging_to(log_file), archive_errors(archive), locked(archive), progress(count, study) as advance:
        executor = executor_for(workers, cluster, (archive,))
        request = Request(
            archive,
            executor,
            profiles=profiles,
            quick=quick,
            estimate=estimate,
            observations=observations,
            truth=truth,
            budget=budget,
            models=models,
            reference=reference,
            assignments=_check_study_names(assignments),
            on_profile=lambda _: advance(),
        )
        for name in _names(study, request):
            folder = _folder(out, archive, name, estimate, alone=study != ALL)
            check_folder(folder)
            try:
                status = max(status, write_and_print(analyze_archive(name, request), name, folder))
            except InputError as error:
                if study != ALL:
                    raise
                echo(f"{name} failed: {error}", err=True)
                status = 1
    return status


def _check_study_names(assignments: tuple[str, ...]) -> tuple[str, ...]:
    """Check that each assignment names its study, and return the assignments."""
    for text in assignments:
        if text.partition(".")[0] not in STUDIES:
            raise InputError(f"--set {text}: write STUDY.KEY=VALUE, for example --set currents.bin=5")
    return assignments


def _folder(out: Path | None, archive: Path, name: str, estimate: str, alone: bool) -> Path:
    default = default_folder(archive, name, estimate)
    if out is None:
        return default
    return out if alone else out / default.name


def _names(study: str, request: Request) -> Iterator[str]:
    """Yield the studies to run; check the inputs of each only after the previous studies have run."""
    if study != ALL:
        yield study
        return
    for name in STUDIES:
        lack = missing_input(name, request)
        if lack is None:
            yield name
        else:
            echo(f"{name} left out: {lack}", err=True)


@click.command("validate", cls=Verb)
@click.argument("observations", type=click.Path(path_type=Path))
@options.platform
@options.store
@options.profiles
@click.option("--quick", is_flag=True, help=f"The first {QUICK_PROFILES} of the profiles only.")
@options.workers
@options.assignments
@options.study_folder
@options.log_file
def validate(
    observations: Path,
    platform_name: str,
    store: Location,
    profiles: str | None,
    quick: bool,
    workers: int | None,
    assignments: tuple[str, ...],
    out: Path | None,
    log_file: Path | None,
) -> int:
    """Simulate every profile of OBSERVATIONS open loop with its recorded controls, and compare it with the record.

    The archive is the one that run-mission made from OBSERVATIONS; the comparison goes into its group `validation`.
    Exit status 1: some profiles could not be simulated.

    \b
    Example:
      gliderhpc validate mission.nc --platform petrel-l --store mission.zarr
      gliderhpc validate m12.nc --platform seaexplorer --set platform.buoyancy.neutral_volume=-215 --store m12.zarr
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    store = archive_on_disk(store)
    out = out or default_folder(store, VALIDATION)
    check_folder(out)
    values, platform_values = parse_assignments(assignments)
    platform = load_platform(platform_name, platform_values)
    with archive_errors(store), open_for_reading(store) as archive:
        settings = build_settings(read_attributes(store)["settings"], values)
        count = len(load_study(VALIDATION).choose(archive, profiles, quick))
    with (
        logging_to(log_file),
        archive_errors(store),
        locked(store),
        open_observations(observations) as opened,
        progress(count, "profiles") as advance,
    ):
        request = Request(
            store,
            executor_for(workers),
            profiles=profiles,
            quick=quick,
            simulation=Simulation(opened, platform, settings),
            on_profile=lambda _: advance(),
        )
        findings = analyze_archive(VALIDATION, request)
    return write_and_print(findings, VALIDATION, out)


def write_and_print(findings: Findings, study: str, folder: Path) -> int:
    """Write and print a study's findings, and return the exit status."""
    written = write_findings(findings, study, folder)
    console = results()
    for title, rows in findings.comparisons.items():
        if rows:
            console.print(comparison_table(rows, title))
    for remark in findings.remarks:
        echo(f"note: {remark}")
    print_left_out(findings.failed)
    for path in written:
        echo(f"written to {path}")
    return 1 if findings.failed else 0
