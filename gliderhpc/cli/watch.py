"""``gliderhpc watch``: inversion of every new dive as its files arrive, with a JSON message for each."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from gliderhpc.cli import options
from gliderhpc.cli.console import logging_to
from gliderhpc.cli.messages import Verb, echo
from gliderhpc.estimation.engines import check_engine
from gliderhpc.flight.glider import load_platform
from gliderhpc.mission.settings import build_settings, parse_assignments
from gliderhpc.observations.files.landing import folder_of
from gliderhpc.store_schema.location import Location, check_assertions, is_address
from gliderhpc.surfacing.dive_plan import read_plan
from gliderhpc.surfacing.message import SurfacingMessage
from gliderhpc.watch.alerts import Alerts, read_alerts
from gliderhpc.watch.records import KINDS, FileImport
from gliderhpc.watch.watcher import Listener, Watch, WatchInputs, open_watch
from gliderhpc.yaml_text import parse_value, split_assignment

_DAY = 86_400.0


def _print_schema(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value:
        echo(json.dumps(SurfacingMessage.model_json_schema(), indent=1))
        ctx.exit()


@click.command("watch", cls=Verb)
@click.argument("source", type=click.Path())
@options.platform
@options.store
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for messages, copies of the files, and state.  [default: ARCHIVE-watch in the archive's folder]",
)
@click.option("--once", is_flag=True, help="Process the files that are already there and exit, for cron.")
@click.option("--replay", is_flag=True, help="Process a finished mission dive by dive, as if each had just arrived.")
@click.option(
    "--settle",
    type=options.Finite(0.0, _DAY),
    default=60.0,
    show_default=True,
    help="With --once: use files that were last changed at least this many seconds ago.",
)
@click.option(
    "--interval",
    type=options.Finite(0.1, _DAY),
    default=30.0,
    show_default=True,
    help="Seconds between checks of SOURCE; a file is used once two successive checks find it unchanged.",
)
@click.option("--kind", type=options.Choice(KINDS), help="Kind of the files.  [default: by name and content]")
@click.option(
    "--import", "import_options", multiple=True, metavar="KEY=VALUE", help="Option of the importer; repeatable."
)
@click.option(
    "--workers",
    type=click.IntRange(0, options.MAX_WORKERS),
    help="Worker processes; 0 to compute in this process.  [default: 0 for one new dive, one per core for several]",
)
@options.preset
@options.start
@options.assignments
@click.option(
    "--alerts",
    "alerts_file",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.yaml",
    help="Alert rules, and the command or address to notify when a dive triggers one.",
)
@click.option(
    "--plan",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.yaml",
    help="Heading, duration or speed of the next dive, for the predicted surfacing; read again for each message.",
)
@click.option(
    "--schema",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_schema,
    help="Print the JSON schema of the messages and exit.",
)
@options.log_file
def watch(
    source: str,
    platform_name: str,
    store: Location,
    out: Path | None,
    once: bool,
    replay: bool,
    settle: float,
    interval: float,
    kind: str | None,
    import_options: tuple[str, ...],
    workers: int | None,
    preset: str,
    start: str | None,
    assignments: tuple[str, ...],
    alerts_file: Path | None,
    plan: Path | None,
    log_file: Path | None,
) -> int:
    """Invert and report every new dive as its files arrive in SOURCE.

    SOURCE is a folder, a file, or a quoted pattern: files of the observation format, or the glider's own (Seaglider,
    SeaExplorer, Slocum, OG1). Each dive is added to the archive, and reported in a line and a JSON message. A file
    that is still being written, or is damaged, is tried again when it has changed. The command can be stopped and
    started again at any time. Without --once or --replay it runs until it is interrupted.

    Exit status 0: done, or nothing new; 1: a dive failed or a file could not be used; 2: unusable input; 130:
    interrupted, the next run continues.

    \b
    Examples:
      gliderhpc watch from-glider/ --platform sea035.yaml --store m12.zarr
      gliderhpc watch 'sg249/p249*.nc' --platform sg249.yaml --store sg249.zarr --once --settle 120
      gliderhpc watch from-glider/ --platform sea035.yaml --store m12.zarr --alerts alerts.yaml
      gliderhpc watch sg249/ --platform sg249.yaml --store again.zarr --replay
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    check_assertions()
    if once and replay:
        raise click.UsageError("--once and --replay are mutually exclusive; give one of them")
    if replay and plan is not None:
        raise click.UsageError("--plan is for the next dive of a mission in progress; omit it with --replay")
    if plan is not None:
        read_plan(plan)
    values, platform_values = parse_assignments(assignments)
    settings = build_settings({"preset": preset, "start": start}, values)
    check_engine(settings)
    watched = WatchInputs(
        source=source,
        importing=FileImport(kind, dict(_option(text) for text in import_options), folder_of(source)),
        platform=load_platform(platform_name, platform_values),
        settings=settings,
        store=store,
        out=_folder(store) if out is None else out,
        workers=workers,
        plan=plan,
    )
    speaker = _WatchPrinter(None if alerts_file is None else read_alerts(alerts_file))
    with logging_to(log_file), open_watch(watched, Listener(speaker.print_dive, _print_fault)) as opened:
        _run(opened, once, replay, settle, interval)
    return 1 if opened.failed or speaker.failed else 0


def _run(opened: Watch, once: bool, replay: bool, settle: float, interval: float) -> None:
    if replay:
        opened.replay()
    elif once:
        opened.once(settle)
    else:
        opened.forever(interval)


def _option(text: str) -> tuple[str, Any]:
    key, value = split_assignment(text, "--import", "KEY=VALUE", "declination=15.4")
    name = key.replace("-", "_")
    return name, parse_value(value, f"--import {key}", "neither a number nor a word")


def _folder(store: Location) -> Path:
    if is_address(store):
        raise click.UsageError("--out is required when the archive is in an object store")
    path = Path(store) if Path(store).stem.strip(".") else Path(store).resolve()
    return path.with_name(f"{path.name.removesuffix('.zarr')}-watch")


@dataclass
class _WatchPrinter:
    """Printer of dives and their alerts, which also sends the alerts."""

    alerts: Alerts | None
    failed: int = 0

    def print_dive(self, message: SurfacingMessage, path: Path) -> None:
        echo(message.line.replace("\n", " "))
        if self.alerts is None:
            return
        broken, failures = self.alerts.check_and_send(message, path)
        for alert in broken:
            echo(f"alert: dive {message.profile}: {alert}")
        for failure in failures:
            self.failed += 1
            echo(f"alert not sent: {failure}", err=True)


def _print_fault(name: str, why: str) -> None:
    echo(f"{name}: not used: {why}", err=True)
