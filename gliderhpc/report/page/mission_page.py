"""Page of a mission, and page of one of its profiles: sections in order, and their files."""

import datetime
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from gliderhpc.archive.mission import Summary, archive_errors, describe, open_for_reading, platform_name
from gliderhpc.archive.reader import Archive
from gliderhpc.mission.executors import Executor, SerialExecutor
from gliderhpc.platform import Platform, platform_yaml
from gliderhpc.report.page.content import Page, PageSection, drawn
from gliderhpc.report.page.operator_summary import operator_section
from gliderhpc.report.page.overview import overview_section
from gliderhpc.report.page.profile_page import profile_page, representative_section
from gliderhpc.report.page.rendering import ReportFiles, write_page
from gliderhpc.report.page.reproduction import PLATFORM_FILE, platform_option, provenance_section
from gliderhpc.report.page.study_sections import published_section, study_names, study_section, windows_section
from gliderhpc.store_schema.location import Location
from gliderhpc.studies.archived import platform_or_none
from gliderhpc.version import __version__
from gliderhpc.wording import counted

MISSION_PAGE = "index.html"
"""File name of a mission's page, and of a fleet's."""


def write_mission_page(
    place: Location,
    out: Path,
    twins: Path | None = None,
    truth: Path | None = None,
    executor: Executor | None = None,
) -> ReportFiles:
    """Write the page of a mission, its tables and its figures.

    Parameters
    ----------
    place : str or Path
        The archive.
    out : Path
        Folder for ``index.html``, ``*.csv``, ``*.png`` and ``*.svg``; created if missing.
    twins : Path, optional
        Output folder of ``twin windows``, for a section of the page.
    truth : Path, optional
        Truth of a synthetic mission, for the representative profile.
    executor : Executor, optional
        Executor whose workers make the sections; by default this process.

    Raises
    ------
    InputError
        Archive, twins or truth cannot be read, or the folder cannot be written.
    """
    with archive_errors(place) as check_unchanged, open_for_reading(place) as archive:
        summary, source = describe(place), PageSource(place, out, twins, truth)
        page = mission_page(archive, summary, source, executor or SerialExecutor())
        check_unchanged()
        written = write_page(page, out, MISSION_PAGE, footer(place))
        _write_platform(archive, out)
    return written


@dataclass(frozen=True)
class PageSource:
    """Source of a page and the folder that it is written to, as arguments of the command.

    Attributes
    ----------
    place : str or Path
        The archive.
    out : Path
        Output folder.
    twins, truth : Path, optional
        Output folder of ``twin windows``, and truth of a synthetic mission.
    """

    place: Location
    out: Path
    twins: Path | None = None
    truth: Path | None = None

    @property
    def command(self) -> str:
        """Command that writes the mission's page."""
        files = {"--out": self.out, "--twins": self.twins, "--truth": self.truth}
        options = [f"{name} {shlex.quote(str(path))}" for name, path in files.items() if path is not None]
        return " ".join(["gliderhpc report", shlex.quote(str(self.place)), *options])

    def profile_command(self, number: int | str) -> str:
        """Return the command that writes the page of a profile."""
        return f"{replace(self, twins=None).command} --profile {number}"


def mission_page(archive: Archive, summary: Summary, source: PageSource, executor: Executor) -> Page:
    """Assemble the mission's page: operator's summary, overview, representative profile, studies, and reproduction."""
    # First, since a wrong folder of twins should not be refused only after everything is drawn.
    windows = windows_section(source.twins, platform_option(archive))
    short, overview, representative, *studies = _drawn_sections(
        source.place,
        (
            partial(operator_section, summary=summary),
            partial(overview_section, summary=summary),
            partial(representative_section, command=source.profile_command("N"), truth=source.truth),
            *(partial(study_section, name, summary=summary, place=source.place) for name in study_names()),
        ),
        executor,
    )
    sections = (
        short,
        overview,
        representative,
        published_section(archive, source.twins is not None),
        *studies,
        windows,
        provenance_section(archive, source.place, source.command),
    )
    done, profiles = summary.statuses.get("done", 0), counted(sum(summary.statuses.values()), "profile")
    subtitle = f"{platform_name(summary.attributes)}: forces, moments and currents of {done} of {profiles}"
    present = tuple(section for section in sections if section is not None)
    return Page(str(summary.attributes.get("mission") or "mission"), subtitle, present)


MakeSection = Callable[..., PageSection | None]
"""Function that makes a section, or None, from an archive passed as the keyword argument `archive`."""


def _drawn_sections(place: Location, makers: Sequence[MakeSection], executor: Executor) -> list[PageSection | None]:
    """Make sections of an archive, with their figures drawn, on the workers of an executor."""
    sections = dict(executor.run(partial(_drawn_section, place), list(enumerate(makers))))
    return [sections[index] for index in range(len(makers))]


def _drawn_section(place: Location, job: tuple[int, MakeSection]) -> tuple[int, PageSection | None]:
    """Make one section, as the job of a worker."""
    index, make = job
    with archive_errors(place), open_for_reading(place) as archive:
        section = make(archive=archive)
        return index, None if section is None else drawn(section)


def write_profile_page(place: Location, number: int, out: Path, truth: Path | None = None) -> ReportFiles:
    """Write the page of one profile, ``profile_N.html``, into the folder of the mission's page.

    Raises
    ------
    InputError
        The archive cannot be read, there is no such profile or it is not done, or the folder cannot be written.
    """
    with archive_errors(place) as check_unchanged, open_for_reading(place) as archive:
        command = PageSource(place, out, truth=truth).profile_command(number)
        page = profile_page(archive, number, place, command, truth)
        check_unchanged()
        written = write_page(page, out, f"profile_{number}.html", footer(place))
        _write_platform(archive, out)
    return written


def footer(source: Location) -> str:
    """Return the line at the foot of a page made from an archive, or from the described source."""
    now = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
    return f"Made by gliderhpc {__version__} from {source} on {now}."


def _write_platform(archive: Archive, out: Path) -> None:
    """Write the platform file, which the page's commands need, if no shipped platform is the same."""
    platform = platform_or_none(archive)
    if platform is not None and platform_option(archive) == PLATFORM_FILE:
        # The archive holds every key; one at its default is not among those that the platform file stated.
        stated = Platform.model_validate(platform.model_dump(exclude_defaults=True))
        (out / PLATFORM_FILE).write_text(platform_yaml(stated), "utf-8")
