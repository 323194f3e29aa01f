"""``gliderhpc analyze``: the studies of a finished mission."""

from pathlib import Path

import click

from gliderhpc.analysis.archived import chosen_profiles
from gliderhpc.analysis.registry import STUDIES, run_study, runnable
from gliderhpc.analysis.study import Request, default_folder
from gliderhpc.cli import options
from gliderhpc.cli.progress import logging_to, progress
from gliderhpc.cli.studies import conclude, executor_for
from gliderhpc.errors import InputError
from gliderhpc.mission.archive import open_mission

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
    "--budget", type=click.Path(path_type=Path), help="For currents: budget.yaml of `gliderhpc twin recoverability`."
)
@click.option(
    "--model", "models", multiple=True, metavar="FILE_OR_URL",
    help="For reanalysis: a file, quoted pattern or OPeNDAP address of an ocean model; repeatable.",
)  # fmt: skip
@options.study_assignments
@options.workers
@options.study_folder
@options.log_file
def command(
    archive: Path, study: str, profiles: str | None, quick: bool, estimate: str, observations: Path | None,
    truth: Path | None, budget: Path | None, models: tuple[str, ...], assignments: tuple[str, ...],
    workers: int | None, out: Path | None, log_file: Path | None,
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
      gliderhpc analyze mission.zarr reanalysis --model hycom.nc --model glorys.nc
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    with open_mission(archive) as opened:
        count = len(chosen_profiles(opened, profiles, quick))
    status = 0
    with logging_to(log_file), progress(count, study) as advance:
        request = Request(
            archive, executor_for(workers), profiles, quick, estimate, observations, truth, budget, models,
            _of_studies(assignments), lambda _: advance(),
        )  # fmt: skip
        for name in _names(study, request):
            folder = _folder(out, archive, name, estimate, alone=study != ALL)
            status = max(status, conclude(run_study(name, request), name, folder))
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


def _names(study: str, request: Request) -> list[str]:
    if study != ALL:
        return [study]
    names, lacks = runnable(request)
    for name, lack in lacks.items():
        click.echo(f"{name} left out: {lack}", err=True)
    if not names:
        raise InputError("no study has the inputs that it needs")
    return names
