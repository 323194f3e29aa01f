"""Options that several verbs share, each defined once."""

from pathlib import Path

import click

from gliderhpc.mission.profile_data import ADJOINT, ESTIMATES

platform = click.option(
    "--platform", "platform_name", required=True, metavar="NAME_OR_FILE", help="A shipped hull, or a platform file."
)
store = click.option("--store", required=True, type=click.Path(path_type=Path), help="The archive, ARCHIVE.zarr.")
profiles = click.option("--profiles", metavar="LIST", help="Profiles to take, such as 18:20,68; default all.")
workers = click.option(
    "--workers",
    type=click.IntRange(min=0),
    help="Worker processes here; default one a core, 0 for this process alone.",
)
assignments = click.option(
    "--set", "assignments", multiple=True, metavar="KEY=VALUE", help="Override a setting, or platform.KEY; repeatable."
)
study_assignments = click.option(
    "--set", "assignments", multiple=True, metavar="STUDY.KEY=VALUE", help="Override a study's setting; repeatable."
)
preset = click.option(
    "--preset", type=click.Choice(["recommended", "paper"]), default="recommended", show_default=True,
    help="Control-variable transform, or the paper's own choices.",
)  # fmt: skip
start = click.option(
    "--start", type=click.Choice(["prior", "smoothed"]), default="prior", show_default=True,
    help="Whose disturbance the windows start from: the filter's, or the smoother's.",
)  # fmt: skip
estimate = click.option(
    "--estimate", type=click.Choice(ESTIMATES), default=ADJOINT, show_default=True,
    help="Whose disturbances and motion are studied: the windows', or the smoother's.",
)  # fmt: skip
log_file = click.option("--log-file", type=click.Path(dir_okay=False, path_type=Path), help="Also log to this file.")
study_folder = click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the study's files.  [default: ARCHIVE-studies/STUDY beside the archive]",
)  # fmt: skip
