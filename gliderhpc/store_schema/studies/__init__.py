"""The schema of what studies add to an archive, as data: one group and one module a study, none of them required.

A study's group holds one row a profile of the archive, missing for profiles that the study left out, and its findings
as attributes. To add a study's group, declare it in a module here and name it below; creating, writing and checking
follow.
"""

from dataclasses import replace

from gliderhpc.store_schema.mission_groups import MISSION
from gliderhpc.store_schema.schema import PROFILE, SCHEMA_VERSION, Group, Schema, Variable
from gliderhpc.store_schema.studies.currents import currents_group
from gliderhpc.store_schema.studies.drift import drift_group
from gliderhpc.store_schema.studies.events import events_group
from gliderhpc.store_schema.studies.intermittency import intermittency_group
from gliderhpc.store_schema.studies.nulls import nulls_group
from gliderhpc.store_schema.studies.reanalysis import reanalysis_group
from gliderhpc.store_schema.studies.reconstruction import reconstruction_group
from gliderhpc.store_schema.studies.spectra import spectra_group
from gliderhpc.store_schema.studies.validation import validation_group
from gliderhpc.store_schema.studies.vertical import vertical_group

COMPLETE = "complete"
"""Attribute of a study's group: whether the study came to its end."""

DIGESTS = "chunk_digests"
"""Attribute of a study's group: digest of every chunk of its tables."""

MANIFEST = "manifest"
"""Variable of every study that has rows: digests of the chunks of each profile's."""


def _with_manifest(group: Group) -> Group:
    if not any(variable.is_row for variable in group.variables):
        return group
    manifest = Variable(MANIFEST, (PROFILE,), "string", "1", "digests of the chunks of the profile's rows, as JSON")
    return replace(group, variables=(*group.variables, manifest))


STUDIES = Schema(
    SCHEMA_VERSION,
    tuple(
        _with_manifest(group)
        for group in (
            validation_group(),
            reconstruction_group(),
            currents_group(),
            reanalysis_group(),
            vertical_group(),
            spectra_group(),
            intermittency_group(),
            nulls_group(),
            events_group(),
            drift_group(),
        )
    ),
)
"""What studies may add."""


def study_called(name: str) -> Group:
    """Return a study's group.

    Raises
    ------
    KeyError
        No study writes a group of that name.
    """
    return STUDIES[name]


def group_called(name: str) -> Group:
    """Return a group of the mission's or of the studies' schema.

    Raises
    ------
    KeyError
        There is none of that name.
    """
    for schema in (MISSION, STUDIES):
        for group in schema:
            if group.name == name:
                return group
    raise KeyError(f"the archive has no group '{name}'")
