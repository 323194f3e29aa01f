"""The studies that ``gliderhpc analyze`` runs, and those that an archive can show; each imported when asked for."""

import importlib

import xarray as xr

from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.study import Request, Shown, Study
from gliderhpc.errors import InputError
from gliderhpc.store_schema import earlier_study_safe
from gliderhpc.store_schema.studies import COMPLETE

STUDIES = (
    "reconstruction", "currents", "reanalysis", "vertical", "spectra", "intermittency", "nulls", "events", "drift",
)  # fmt: skip
"""Names of the studies, which are those of their modules or packages and of their groups."""

SHOWN = ("validation", *STUDIES)
"""Groups that an archive may hold and show: the studies', and that of ``gliderhpc validate``."""


def load_study(name: str) -> Study:
    """Import a study by its name.

    Raises
    ------
    InputError
        There is no such study.
    """
    if name not in STUDIES:
        raise InputError(f"{name}: no such study; there are {', '.join(STUDIES)}")
    study: Study = importlib.import_module(f"gliderhpc.analysis.{name}").STUDY
    return study


def load_shown(name: str) -> Shown:
    """Import what shows a group by its name.

    Raises
    ------
    InputError
        No study and no validation has that name.
    """
    if name not in SHOWN:
        raise InputError(f"{name}: an archive shows no such study; there are {', '.join(SHOWN)}")
    shown: Shown = importlib.import_module(f"gliderhpc.analysis.{name}").STUDY
    return shown


def studies_in(archive: xr.DataTree) -> list[str]:
    """Names of the studies that an archive holds and that came to their end, in the order of `SHOWN`."""
    return [name for name in SHOWN if name in archive.children and archive[name].attrs.get(COMPLETE, False)]


def show_study(name: str, archive: xr.DataTree) -> Findings:
    """Show one of an archive's studies: its tables, comparisons and figures with captions, from the archive alone.

    Raises
    ------
    InputError
        There is no such study, the archive does not hold it whole, or an earlier version left it.
    """
    shown = load_shown(name)
    if name not in studies_in(archive):
        raise InputError(f"the archive does not hold the study {name}, or it was interrupted; run it first")
    return shown.show(archive)


def run_study(name: str, request: Request) -> Findings:
    """Run one study; what an earlier run of it left in the archive stays where this one fails.

    Raises
    ------
    InputError
        The study is unknown, or the request lacks one of its inputs.
    """
    missing = missing_input(name, request)
    if missing is not None:
        raise InputError(f"{name}: {missing}")
    with earlier_study_safe(request.archive, name):
        return load_study(name).run(request)


def missing_input(name: str, request: Request) -> str | None:
    """Say what a request lacks for a study, None where nothing is missing.

    Raises
    ------
    InputError
        There is no such study, or a setting of it is wrong.
    """
    return load_study(name).missing(request)
