"""The studies that ``gliderhpc analyze`` knows, each imported when it is asked for."""

import importlib

from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.study import Request, Study
from gliderhpc.errors import InputError

STUDIES = (
    "reconstruction", "currents", "reanalysis", "vertical", "spectra", "intermittency", "nulls", "events", "drift",
)  # fmt: skip
"""Names of the studies, which are those of their modules or packages and of their groups."""


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


def run_study(name: str, request: Request) -> Findings:
    """Run one study.

    Raises
    ------
    InputError
        The study is unknown, or the request lacks one of its inputs.
    """
    study = load_study(name)
    missing = study.missing(request)
    if missing is not None:
        raise InputError(f"{name}: {missing}")
    return study.run(request)


def runnable(request: Request) -> tuple[list[str], dict[str, str]]:
    """Tell the studies whose inputs are there from those that lack something, with what they lack."""
    lacks = {name: load_study(name).missing(request) for name in STUDIES}
    return [name for name, lack in lacks.items() if lack is None], {n: lack for n, lack in lacks.items() if lack}
