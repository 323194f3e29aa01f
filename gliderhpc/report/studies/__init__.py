"""Tables, figures and captions of a study, from an archive that contains it.

The function ``show`` of the module named after the study in this package makes them; a study without such a module has
only its table.
"""

import importlib
from collections.abc import Callable
from importlib.util import find_spec

from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError
from gliderhpc.findings.results import Findings, archive_findings
from gliderhpc.report.studies.summaries import describe_data
from gliderhpc.store_schema.schema import COMPLETE, study_called
from gliderhpc.studies.archived import column_medians, failed_profiles, provenance_of, study_table
from gliderhpc.studies.registry import ALL_STUDIES


def show_table(name: str, archive: Archive) -> Findings:
    """Make the findings of a study from nothing but its rows and their declaration in the schema."""
    provenance, table = provenance_of(archive, name), study_table(archive, name)
    failed, known = failed_profiles(table)
    variables = {variable.name: variable for variable in study_called(name).variables}
    meanings = "; ".join(
        f"{column} ({variables[column].units}): {variables[column].long_name}"
        for column in table
        if column in variables and column not in ("profile", "message")
    )
    caption = f"One row per profile: {describe_data(provenance, known['profile'].tolist())}. Columns: {meanings}."
    facts = {"profiles": list(provenance.profiles), "quick": provenance.quick, "medians": column_medians(known)}
    return archive_findings(
        name,
        comparisons=(),
        tables={name: table},
        figures={},
        facts=facts,
        failed=failed,
        remarks=provenance.remarks,
        captions={name: caption},
    )


def studies_in(archive: Archive) -> list[str]:
    """Return the names of the complete studies in an archive, in the order of `ALL_STUDIES`."""
    return [name for name in ALL_STUDIES if name in archive.children and archive[name].attrs.get(COMPLETE, False)]


def show_study(name: str, archive: Archive) -> Findings:
    """Make a study's tables, comparisons and figures with captions, from the archive alone.

    Parameters
    ----------
    name : str
        Name of the study, in `ALL_STUDIES`.
    archive : Archive
        Archive, as opened by `gliderhpc.archive.mission.open_for_reading`.

    Raises
    ------
    InputError
        There is no such study, or that of the archive is missing, incomplete or of an earlier version.
    """
    if name not in ALL_STUDIES:
        raise InputError(f"{name}: not a study that an archive can show; there are {', '.join(ALL_STUDIES)}")
    if name not in studies_in(archive):
        raise InputError(f"the archive does not contain the study {name}, or it was interrupted; run it first")
    if find_spec(f"{__package__}.{name}") is None:
        return show_table(name, archive)
    show: Callable[[Archive], Findings] = importlib.import_module(f"{__package__}.{name}").show
    return show(archive)
