"""Report of an archive, or of several: pages of the mission, of one profile, or of the fleet."""

from collections.abc import Sequence
from pathlib import Path

from gliderhpc.archive.mission import check_is_path
from gliderhpc.errors import InputError
from gliderhpc.output_files import check_folder
from gliderhpc.report.page.fleet import write_fleet
from gliderhpc.report.page.mission_page import write_mission_page, write_profile_page
from gliderhpc.report.page.rendering import ReportFiles, check_outside_archives
from gliderhpc.store_schema.location import Location, is_address


def write_report(
    store: Location | Sequence[Location],
    out: str | Path,
    *,
    profile: int | None = None,
    twins: str | Path | None = None,
    truth: str | Path | None = None,
) -> ReportFiles:
    """Write an archive, or one profile of it, as one self-contained HTML page with its tables and figures.

    For several archives, each page is written into a separate folder below `out`, and ``index.html`` is the page of the
    fleet, with a row for each archive and a map.

    Parameters
    ----------
    store : str or Path, or sequence of these
        The archive, or the archives of a fleet.
    out : str or Path
        Folder for the page, its tables as CSV and its figures as PNG and SVG; created if missing.
    profile : int, optional
        Number of a profile, to write only its page.
    twins : str or Path, optional
        Output folder of ``gliderhpc twin windows``, for the page of the mission.
    truth : str or Path, optional
        Truth file of a synthetic mission, to draw with a profile.

    Returns
    -------
    ReportFiles
        Paths of the ``page``, the ``tables`` and the ``figures``. For several archives they are those of the fleet's
        page, and ``failed`` has a line for each archive without a page.

    Raises
    ------
    InputError
        Archive, twins or truth cannot be read, there is no such profile or it is not done, or the folder cannot be
        written; or, for several archives, none can be read, or `profile`, `twins` or `truth` is set.
    """
    check_is_path(out, "out")
    stores = [store] if isinstance(store, str | Path) else list(store)
    if not stores:
        raise InputError("no archive is given; give at least one")
    if len(stores) > 1 and any(option is not None for option in (profile, twins, truth)):
        raise InputError("profile, twins and truth belong to one archive; leave them out of a fleet's report")
    if profile is not None and twins is not None:
        raise InputError("twins belongs to the page of the mission, not to that of a profile; leave one of them out")
    places, folder = [member if is_address(member) else Path(member) for member in stores], Path(out)
    twins, truth = (None if path is None else Path(path) for path in (twins, truth))
    check_folder(folder)
    if len(places) > 1:
        return write_fleet(places, folder)
    check_outside_archives(places, [folder])
    place = places[0]
    if profile is None:
        return write_mission_page(place, folder, twins, truth)
    return write_profile_page(place, profile, folder, truth)
