"""``gliderhpc validate``: the fixed-parameter forward model against the records."""

from pathlib import Path

import click

from gliderhpc.api.studies import validated_profiles
from gliderhpc.archive.mission import open_mission, reading
from gliderhpc.cli import options
from gliderhpc.cli.console import logging_to, progress
from gliderhpc.cli.options import executor_for
from gliderhpc.cli.outputs import conclude
from gliderhpc.flight.loading import load_platform
from gliderhpc.mission.lock import locked
from gliderhpc.mission.settings import build_settings, parse_assignments
from gliderhpc.observations import open_observations
from gliderhpc.output_files import check_folder
from gliderhpc.report.analyze import validate_archive
from gliderhpc.store_schema import read_attributes
from gliderhpc.studies.archived import QUICK_PROFILES
from gliderhpc.studies.study import default_folder
from gliderhpc.studies.validation import GROUP


@click.command("validate")
@click.argument("observations", type=click.Path(path_type=Path))
@options.platform
@options.store
@options.profiles
@click.option("--quick", is_flag=True, help=f"The first {QUICK_PROFILES} of the profiles only.")
@options.workers
@options.assignments
@options.study_folder
@options.log_file
def command(
    observations: Path, platform_name: str, store: Path, profiles: str | None, quick: bool, workers: int | None,
    assignments: tuple[str, ...], out: Path | None, log_file: Path | None,
) -> int:  # fmt: skip
    """Fly every profile of OBSERVATIONS open loop under its recorded controls, and hold it against the record.

    The archive is the one that run-mission made from OBSERVATIONS; the comparison goes into its group `validation`.
    Exit status 1: some profiles could not be flown.

    \b
    Example:
      gliderhpc validate mission.nc --platform petrel-l --store mission.zarr
      gliderhpc validate m12.nc --platform seaexplorer --set platform.buoyancy.neutral_volume=-215 --store m12.zarr
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    out = out or default_folder(store, GROUP)
    check_folder(out)
    values, platform_values = parse_assignments(assignments)
    platform = load_platform(platform_name, platform_values)
    with reading(store), open_mission(store):
        settings = build_settings(read_attributes(store)["settings"], values)
    with (
        logging_to(log_file),
        reading(store),
        locked(store),
        open_observations(observations) as opened,
    ):
        numbers = validated_profiles(store, profiles, quick)
        with progress(len(numbers), "profiles") as advance:
            findings = validate_archive(
                opened, platform, settings, store, executor_for(workers), profiles=",".join(map(str, numbers)),
                report=lambda _: advance(),
            )  # fmt: skip
    return conclude(findings, GROUP, out)
