"""``gliderhpc analyze``: the studies of a finished mission."""

from collections.abc import Iterator
from pathlib import Path

import click

from gliderhpc.archive.mission import open_mission, reading
from gliderhpc.cli import options
from gliderhpc.cli.console import logging_to, progress
from gliderhpc.cli.messages import say
from gliderhpc.cli.options import executor_for
from gliderhpc.cli.outputs import conclude
from gliderhpc.errors import InputError
from gliderhpc.mission.cluster import ClusterAddress
from gliderhpc.mission.lock import locked
from gliderhpc.output_files import check_folder
from gliderhpc.report.analyze import analyze_archive
from gliderhpc.studies.archived import chosen_profiles
from gliderhpc.studies.registry import STUDIES, missing_input
from gliderhpc.studies.study import Request, default_folder

ALL = "all"


@click.command("analyze")
@click.argument("archive", type=click.Path(path_type=Path))
@click.argument("study", type=click.Choice([*STUDIES, ALL]))
@options.profiles
@click.option("--quick", is_flag=True, help="A size for a first look.")
@options.estimate
@click.option(
    "--observations", type=click.Path(path_type=Path), help="The observation file, where a study inverts anew."
)
@click.option("--truth", type=click.Path(path_type=Path), help="A synthetic mission's truth file.")
@click.option(
    "--budget", type=click.Path(path_type=Path), help="For currents: budget by `twin recoverability` or `currents`."
)
@click.option(
    "--model", "models", multiple=True, metavar="FILE_OR_URL",
    help="For reanalysis: a file, quoted pattern or OPeNDAP address of an ocean model; repeatable.",
)  # fmt: skip
@click.option(
    "--reference", type=click.Path(path_type=Path),
    help="For currents: a current profiler's file, or an imported one with the operator's own currents.",
)  # fmt: skip
@options.study_assignments
@options.workers
@options.cluster
@options.study_folder
@options.log_file
def command(
    archive: Path, study: str, profiles: str | None, quick: bool, estimate: str, observations: Path | None,
    truth: Path | None, budget: Path | None, models: tuple[str, ...], reference: Path | None,
    assignments: tuple[str, ...], workers: int | None, cluster: ClusterAddress | None, out: Path | None,
    log_file: Path | None,
) -> int:  # fmt: skip
    """Run STUDY on a finished mission, or `all` those whose inputs are there, into the archive's group of its name.

    Each leaves CSV, PNG and JSON files and prints the paper's figures beside its own.

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
    with reading(archive), open_mission(archive) as opened:
        count = len(chosen_profiles(opened, profiles, quick))
    status = 0
    with logging_to(log_file), reading(archive), locked(archive), progress(count, study) as advance:
        executor = executor_for(workers, cluster, (archive,))
        request = Request(
            archive, executor, profiles, quick, estimate, observations, truth, budget, models,
            reference, _of_studies(assignments), lambda _: advance(),
        )  # fmt: skip
        for name in _names(study, request):
            folder = _folder(out, archive, name, estimate, alone=study != ALL)
            check_folder(folder)
            try:
                status = max(status, conclude(analyze_archive(name, request), name, folder))
            except InputError as error:
                if study != ALL:
                    raise
                say(f"{name} failed: {error}", err=True)
                status = 1
    return status


def _of_studies(assignments: tuple[str, ...]) -> tuple[str, ...]:
    """Hand the assignments on where each names its study."""
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
    """Give the studies to run one by one: each is judged when its turn comes, for it may build on those before it."""
    if study != ALL:
        yield study
        return
    for name in STUDIES:
        lack = missing_input(name, request)
        if lack is None:
            yield name
        else:
            say(f"{name} left out: {lack}", err=True)
