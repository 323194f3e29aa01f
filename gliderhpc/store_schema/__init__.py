"""Mission archive: its schema as data, and creation, writing, verification and comparison of archives."""

from gliderhpc.store_schema.check import check_archive, other_version, structure_differences, version_note
from gliderhpc.store_schema.commits import Commit, committed_rows, read_commits
from gliderhpc.store_schema.consolidation import consolidate
from gliderhpc.store_schema.create import create_archive, set_attributes
from gliderhpc.store_schema.deep_check import committed_chunk_faults, damaged_chunks, missing_chunks
from gliderhpc.store_schema.digests import Digests
from gliderhpc.store_schema.location import Location, is_archive
from gliderhpc.store_schema.rows import (
    ArchiveRows,
    read_attributes,
    read_profiles,
    write_coordinates,
    write_mission_table,
    write_table_rows,
    write_whole,
)
from gliderhpc.store_schema.schema import BUOYANCY, DISTURBANCE_PRIOR, MISSION, OUTCOME, SCHEMA_VERSION, STATUS, STUDIES
from gliderhpc.store_schema.study_groups import (
    create_study,
    finish_study,
    restored_on_error,
    set_study_attributes,
    study_attributes,
    write_manifests,
)
from gliderhpc.vocabulary import QUALITY

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
    "Commit",
    "Digests",
    "Location",
    "check_archive",
    "committed_chunk_faults",
    "committed_rows",
    "consolidate",
    "create_archive",
    "create_study",
    "damaged_chunks",
    "finish_study",
    "is_archive",
    "missing_chunks",
    "other_version",
    "read_attributes",
    "read_commits",
    "read_profiles",
    "restored_on_error",
    "set_attributes",
    "set_study_attributes",
    "structure_differences",
    "study_attributes",
    "version_note",
    "write_coordinates",
    "write_manifests",
    "write_mission_table",
    "write_table_rows",
    "write_whole",
]

if __name__ != "gliderhpc.store_schema":
    raise ImportError(
        "'store_schema' at the top of the repository is a link into the package; import gliderhpc.store_schema"
    )
