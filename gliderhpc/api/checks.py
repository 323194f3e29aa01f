"""Checks of a mission's records before they are inverted."""

from dataclasses import dataclass
from typing import Any

import pandas as pd
from threadpoolctl import threadpool_limits

from gliderhpc.api.arguments import Hull, Profiles, platform_of, profiles_text, settings_of
from gliderhpc.errors import InputError
from gliderhpc.mission.planning import select_profiles
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations
from gliderhpc.observations.in_memory import Records, opened_records
from gliderhpc.platform import Platform
from gliderhpc.report.record_checks import content
from gliderhpc.tuning.record_checks import Inspection, inspect_records
from gliderhpc.wording import speaks_python


@dataclass(frozen=True, eq=False)
class RecordsInspected:
    """What the checks of the records found.

    Attributes
    ----------
    inspection : Inspection
        Findings, profiles looked at, and those left out with why.
    """

    inspection: Inspection

    @property
    def table(self) -> pd.DataFrame:
        """One row a finding: check, quantity, unit, size, standard error, threshold, verdict, suggestion, remark."""
        rows = content(self.inspection)["findings"]
        return pd.DataFrame(rows).astype(dict.fromkeys(("size", "standard_error", "threshold"), float))

    @property
    def suggestions(self) -> dict[str, str]:
        """By quantity that was found wrong, what would correct it."""
        return {finding.quantity: finding.suggestion for finding in self.inspection.found}

    @property
    def left_out(self) -> dict[int, str]:
        """Profiles that could not be looked at, and why."""
        return self.inspection.left_out


@speaks_python
def inspect(
    records: Records, hull: Hull, *, profiles: Profiles = None, settings: MissionSettings | None = None, **named: Any
) -> RecordsInspected:
    """Check records before they are inverted: lag of depth behind attitude, offset and scale of the pitch, compass.

    Parameters
    ----------
    records : xarray.Dataset, str or Path
        Observations.
    hull : Platform, str or Path
        The hull, calibrated.
    profiles : int, iterable of int, or str, optional
        Profiles to choose among; all by default.
    settings : MissionSettings, optional
        Settings, of which ``inspect`` and ``records`` matter.
    **named
        Settings by name, over those of `settings`: ``inspect={"profiles": 200}``.

    Returns
    -------
    RecordsInspected
        With ``.table``, ``.suggestions`` and ``.left_out``. Nothing is corrected.

    Raises
    ------
    InputError
        An argument cannot be used, or no profile can be inspected.
    """
    chosen, platform = settings_of(MissionSettings, settings, named), platform_of(hull)
    with opened_records(records) as observations:
        return RecordsInspected(inspected(observations, platform, chosen, profiles_text(profiles)))


def inspected(
    observations: Observations, platform: Platform, settings: MissionSettings, profiles: str | None
) -> Inspection:
    """Inspect an open file, as `inspect` does."""
    with threadpool_limits(limits=1):
        numbers = select_profiles(observations.profile_numbers, profiles)
        found = inspect_records(observations, platform, numbers, settings, settings.inspect, settings.current)
    if not found.profiles:
        raise InputError(f"{observations.path}: no profile can be inspected; {next(iter(found.left_out.values()))}")
    return found
