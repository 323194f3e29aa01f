"""Running a study of an archive, and the comparison of the forward model, to their tables and figures."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.findings.findings import Findings
from gliderhpc.findings.tables import as_plain
from gliderhpc.mission.executors import Executor
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations
from gliderhpc.platform import Platform
from gliderhpc.report.studies.registry import show_study
from gliderhpc.store_schema import restored_on_error, set_study_attributes
from gliderhpc.studies import validation
from gliderhpc.studies.registry import run_study
from gliderhpc.studies.study import Request


def analyze_archive(name: str, request: Request) -> Findings:
    """Run one study; the group that an earlier run left in the archive stays as it was where this one fails.

    Raises
    ------
    InputError
        The study is unknown, or the request lacks one of its inputs.
    """
    with restored_on_error(request.archive, name):
        run_study(name, request)
        return _findings(name, request.archive)


def validate_archive(
    observations: Observations,
    platform: Platform,
    settings: MissionSettings,
    store: str | Path,
    executor: Callable[[], AbstractContextManager[Executor]],
    *,
    profiles: str | None = None,
    report: Callable[[int], None] = lambda _: None,
) -> Findings:
    """Compare the forward model with an archive's records; parameters as `gliderhpc.studies.validation.validate`.

    Raises
    ------
    InputError
        The archive was made from other observations or on other axes, or has no such profile.
    """
    with restored_on_error(store, validation.GROUP):
        validation.validate(observations, platform, settings, store, executor, profiles=profiles, report=report)
        return _findings(validation.GROUP, store)


def _findings(name: str, store: str | Path) -> Findings:
    """Make a study's findings, and leave their facts and comparisons among the attributes of its group."""
    with open_for_reading(store) as archive:
        findings = show_study(name, archive)
    found = {**findings.content["facts"], "comparisons": findings.content["comparisons"]}
    set_study_attributes(store, name, as_plain(found))
    return findings
