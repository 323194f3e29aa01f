"""Tables, figures and captions of a study, from an archive that contains it.

The function ``show`` of the module named after the study in this package makes them; a study without such a module has
only its table.
"""

import importlib
from collections.abc import Callable
from importlib.util import find_spec

from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError
from gliderhpc.findings.findings import Findings, archive_findings
from gliderhpc.report.studies.summaries import describe_data
from gliderhpc.store_schema.schema import COMPLETE, study_called
from gliderhpc.studies.archived import column_medians, failed_profiles, provenance_of, study_table
from gliderhpc.studies.registry import STUDIES, load_study
from gliderhpc.studies.validation import GROUP as VALIDATION
from gliderhpc.studies.validation import TITLE


def show_table(name: str, archive: Archive) -> Findings:
    """Make the findings of a study from nothing but its rows and their declaration in the schema."""
    made, table = provenance_of(archive, name), study_table(archive, name)
    failed, known = failed_profiles(table)
    variables = {variable.name: variable for variable in study_called(name).variables}
    meanings = "; ".join(
        f"{column} ({variables[column].units}): {variables[column].long_name}"
        for column in table
        if column in variables and column not in ("profile", "message")
    )
    caption = f"One row per profile: {describe_data(made, known['profile'].tolist())}. Columns: {meanings}."
    facts = {"profiles": list(made.profiles), "quick": made.quick, "medians": column_medians(known)}
    return archive_findings(
        name,
        comparisons=(),
        tables={name: table},
        figures={},
        facts=facts,
        failed=failed,
        remarks=made.remarks,
        captions={name: caption},
    )


SHOWN = (VALIDATION, *STUDIES)
"""Groups of an archive that can be shown: that of ``gliderhpc validate``, and those of the studies."""


def study_title(name: str) -> str:
    """Return a one-line title of a group of `SHOWN`."""
    return TITLE if name == VALIDATION else load_study(name).title


def studies_in(archive: Archive) -> list[str]:
    """Return the names of the complete studies in an archive, in the order of `SHOWN`."""
    return [name for name in SHOWN if name in archive.children and archive[name].attrs.get(COMPLETE, False)]


def show_study(name: str, archive: Archive) -> Findings:
    """Make a study's tables, comparisons and figures with captions, from the archive alone.

    Parameters
    ----------
    name : str
        Name of the study, in `SHOWN`.
    archive : Archive
        Archive, as opened by `gliderhpc.archive.mission.open_for_reading`.

    Raises
    ------
    InputError
        There is no such study, or that of the archive is missing, incomplete or of an earlier version.
    """
    if name not in SHOWN:
        raise InputError(f"{name}: not a study that an archive can show; there are {', '.join(SHOWN)}")
    if name not in studies_in(archive):
        raise InputError(f"the archive does not contain the study {name}, or it was interrupted; run it first")
    if find_spec(f"{__package__}.{name}") is None:
        return show_table(name, archive)
    show: Callable[[Archive], Findings] = importlib.import_module(f"{__package__}.{name}").show
    return show(archive)
