"""From an archive to a page: the whole mission, or one profile of it."""

import datetime
import shlex
from pathlib import Path

import xarray as xr

from gliderhpc.archive.opening import Summary, describe, open_for_reading, reading
from gliderhpc.platform import platform_yaml
from gliderhpc.report.page.content import Page, Section
from gliderhpc.report.page.overview import overview_section
from gliderhpc.report.page.paper import published_section
from gliderhpc.report.page.profile_page import profile_page
from gliderhpc.report.page.provenance import provenance_section
from gliderhpc.report.page.rendering import Written, write_page
from gliderhpc.report.page.representative import representative_section
from gliderhpc.report.page.reproduction import PLATFORM_FILE, own_platform, platform_option
from gliderhpc.report.page.studies import study_sections
from gliderhpc.report.page.twins import windows_section
from gliderhpc.report.profile_heading import platform_name
from gliderhpc.store_schema.place import Place
from gliderhpc.version import __version__

MISSION_PAGE = "index.html"


def write_mission_page(place: Place, out: Path, twins: Path | None = None, truth: Path | None = None) -> Written:
    """Write the page of a mission, its tables and its figures.

    Parameters
    ----------
    place : str or Path
        The archive.
    out : Path
        Folder for ``index.html``, ``*.csv``, ``*.png`` and ``*.svg``; made where it is missing.
    twins : Path, optional
        Folder that ``twin windows`` left, which is shown too.
    truth : Path, optional
        Truth of a synthetic mission, for the representative profile.

    Raises
    ------
    InputError
        Archive, twins or truth cannot be read, or the folder cannot be written.
    """
    summary = describe(place)
    with reading(place), open_for_reading(place) as archive:
        page = mission_page(archive, summary, place, out, twins, truth)
        written = write_page(page, out, MISSION_PAGE, _made(place))
        _leave_platform(archive, out)
    return written


def mission_page(
    archive: xr.DataTree, summary: Summary, place: Place, out: Path, twins: Path | None, truth: Path | None
) -> Page:
    """The mission's page: overview, a profile for all, every study, and how to reproduce it."""
    representative = representative_section(archive, f"{_command(place, out, None, truth)} --profile N", truth)
    sections: list[Section] = [overview_section(archive, summary)]
    if representative is not None:
        sections.append(representative)
    studies = study_sections(archive, summary, place)
    sections += [
        published_section(archive, twins is not None), *studies, windows_section(twins, platform_option(archive)),
        provenance_section(archive, place, _command(place, out, twins, truth)),
    ]  # fmt: skip
    attributes = summary.attributes
    return Page(str(attributes.get("mission") or "mission"), _subtitle(summary), tuple(sections))


def write_profile_page(place: Place, number: int, out: Path, truth: Path | None = None) -> Written:
    """Write the page of one profile, ``profile_N.html``, beside that of the mission.

    Raises
    ------
    InputError
        The archive cannot be read, there is no such profile or it is not done, or the folder cannot be written.
    """
    with reading(place), open_for_reading(place) as archive:
        command = f"{_command(place, out, None, truth)} --profile {number}"
        page = profile_page(archive, number, place, command, truth)
        written = write_page(page, out, f"profile_{number}.html", _made(place))
        _leave_platform(archive, out)
    return written


def _command(place: Place, out: Path, twins: Path | None, truth: Path | None) -> str:
    """Command that makes a page again."""
    given = {"--out": out, "--twins": twins, "--truth": truth}
    options = [f"{name} {shlex.quote(str(path))}" for name, path in given.items() if path is not None]
    return " ".join(["gliderhpc report", shlex.quote(str(place)), *options])


def _subtitle(summary: Summary) -> str:
    count = sum(summary.statuses.values())
    done = summary.statuses.get("done", 0)
    return f"{platform_name(summary.attributes)}: forces, moments and currents of {done} of {count} profiles"


def _made(place: Place) -> str:
    now = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
    return f"Made by gliderhpc {__version__} from {place} on {now}."


def _leave_platform(archive: xr.DataTree, out: Path) -> None:
    """Leave the hull beside the page where no shipped one is the same, so that the commands on it work."""
    platform = own_platform(archive)
    if platform is not None and platform_option(archive) == PLATFORM_FILE:
        (out / PLATFORM_FILE).write_text(platform_yaml(platform), "utf-8")
