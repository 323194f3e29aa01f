"""The mission archive: its schema as data, and what creates, writes and checks an archive against it."""

from gliderhpc.store_schema.access import (
    ArchiveRows,
    clear_marker,
    read_attributes,
    read_markers,
    read_profiles,
    write_marker,
    write_profile,
    write_table_rows,
)
from gliderhpc.store_schema.check import check_archive
from gliderhpc.store_schema.create import (
    consolidate,
    create_archive,
    create_study,
    finish_study,
    is_archive,
    set_attributes,
    study_attributes,
)
from gliderhpc.store_schema.mission_groups import MISSION
from gliderhpc.store_schema.schema import BUOYANCY, DISTURBANCE_PRIOR, OUTCOME, QUALITY, SCHEMA_VERSION, STATUS
from gliderhpc.store_schema.studies import STUDIES

__all__ = [
    "BUOYANCY",
    "DISTURBANCE_PRIOR",
    "MISSION",
    "OUTCOME",
    "QUALITY",
    "SCHEMA_VERSION",
    "STATUS",
    "STUDIES",
    "ArchiveRows",
    "check_archive",
    "clear_marker",
    "consolidate",
    "create_archive",
    "create_study",
    "finish_study",
    "is_archive",
    "read_attributes",
    "read_markers",
    "read_profiles",
    "set_attributes",
    "study_attributes",
    "write_marker",
    "write_profile",
    "write_table_rows",
]
