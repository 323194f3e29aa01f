"""Studies of an archive, each imported on demand."""

import importlib

from gliderhpc.errors import InputError
from gliderhpc.studies.request import Request, study_assignments
from gliderhpc.studies.study import Study

STUDIES = (
    "reconstruction",
    "currents",
    "reanalysis",
    "vertical",
    "spectra",
    "intermittency",
    "nulls",
    "events",
    "hull",
    "drift",
)
"""Names of the studies that ``gliderhpc analyze`` runs, which are also those of their modules and of their groups."""

VALIDATION = "validation"
"""Name of the study that ``gliderhpc validate`` runs: the forward model compared with the records."""

ALL_STUDIES = (VALIDATION, *STUDIES)
"""Names of all studies."""


def load_study(name: str) -> Study:
    """Import a study by its name.

    Raises
    ------
    InputError
        There is no such study.
    """
    if name not in ALL_STUDIES:
        raise InputError(f"{name}: no such study; there are {', '.join(STUDIES)}")
    study: Study = importlib.import_module(f"gliderhpc.studies.{name}").STUDY
    return study


def run_study(name: str, request: Request) -> None:
    """Run one study into the archive's group of its name.

    Raises
    ------
    InputError
        The study is unknown, or the request lacks one of its inputs.
    """
    study, assignments = load_study(name), study_assignments(request, name)
    settings = study.settings_for(request)
    missing = study.missing(request, settings)
    if missing is not None:
        raise InputError(f"{name}: {missing}")
    if assignments and study.settings is None:
        raise InputError(f"{name}: has no settings, and was given {', '.join(assignments)}")
    study.run(request, settings)


def missing_input(name: str, request: Request) -> str | None:
    """Return a description of the input that a request lacks for a study, or None if nothing is missing.

    Raises
    ------
    InputError
        There is no such study, or one of its settings is wrong.
    """
    study = load_study(name)
    return study.missing(request, study.settings_for(request))
