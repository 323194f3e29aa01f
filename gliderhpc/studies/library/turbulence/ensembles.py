"""Measured profiles and nulls of an archive: the ensembles that are compared, and the nulls' ceiling."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.archive.reader import Archive
from gliderhpc.store_schema.columns import MODEL_ERROR, NOISE_ONLY, REALISATIONS
from gliderhpc.store_schema.schema import COMPLETE
from gliderhpc.studies.archived import as_cells, failed_profiles, outdated_input_remarks, study_table
from gliderhpc.studies.library.turbulence.series import MIN_RMS, FastSettings, IntermittencySettings

Array = NDArray[np.float64]

ARTEFACTS = (NOISE_ONLY, MODEL_ERROR)
"""Families of nulls without any disturbance, which determine the ceiling; a Gaussian null has a disturbance."""

MIN_NULLS = 10
"""Minimum number of nulls without any disturbance whose ceiling decides.

A profile like the nulls exceeds the largest of fewer with a probability of one in ten or more, and few errors of the
hull are among them.
"""

ADDED_SETTINGS = {"noise_window", "most_repeated"}
"""Settings that older studies lack; none of them affects the statistics that those contain."""


@dataclass(frozen=True, eq=False)
class Ensembles:
    """Measured profiles and nulls of a mission.

    Attributes
    ----------
    measured : pandas.DataFrame
        Table of group ``intermittency``, one row for each profile.
    nulls : pandas.DataFrame
        Table of group ``nulls``, one row for each realisation, with the number of its ``surrogates`` if it differs from
        the settings'; empty if there are none.
    settings : IntermittencySettings
        Settings of both.
    """

    measured: pd.DataFrame
    nulls: pd.DataFrame
    settings: IntermittencySettings

    def family(self, name: str) -> pd.DataFrame:
        """Realisations of a family that have statistics."""
        if self.nulls.empty:
            return self.nulls
        return pd.DataFrame(self.nulls.loc[(self.nulls["family"] == name) & (self.nulls["rms"] > MIN_RMS)])

    @property
    def artefacts(self) -> pd.DataFrame:
        """Realisations without any disturbance that have statistics."""
        return pd.concat([self.family(name) for name in ARTEFACTS]) if len(self.nulls) else self.nulls

    @property
    def ceiling(self) -> float:
        """Largest magnitude in the nulls without any disturbance, in the channel's unit; NaN without nulls."""
        return float(self.artefacts["peak"].max()) if len(self.artefacts) else float("nan")

    @property
    def ceiling_count(self) -> int:
        """Number of nulls without any disturbance that determine the ceiling."""
        return len(finite(self.artefacts["peak"])) if len(self.artefacts) else 0

    @property
    def null_level(self) -> float:
        """Smallest p-value of the rank test that both measured profiles and nulls can have."""
        number = self.nulls["surrogates"].min() if "surrogates" in self.nulls else self.settings.surrogates
        return 1.0 / (1 + min(int(number), self.settings.surrogates))

    def measured_values(self, name: str) -> Array:
        """Finite values of a statistic of the measured profiles."""
        if self.measured.empty or name not in self.measured:
            return np.empty(0)
        return finite(self.measured[name])


def null_table(archive: Archive) -> pd.DataFrame:
    """Return the table of an archive's nulls, one row for each realisation."""
    group = archive["nulls"].to_dataset()
    columns = [variable.name for variable in REALISATIONS if variable.name in group]
    return pd.DataFrame({name: as_cells(group[name].values) for name in columns})


def stored_nulls(
    archive: Archive, estimate: str, settings: IntermittencySettings
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Return an archive's nulls for an estimate and settings, and a remark if there are none."""
    attributes = _attributes(archive, "nulls")
    if not attributes.get(COMPLETE, False):
        return pd.DataFrame(), ("there are no nulls to compare the amplitudes with; run the study nulls",)
    if attributes.get("estimate") != estimate:
        return pd.DataFrame(), (
            f"the archive's nulls are of the {attributes.get('estimate')} estimate; run nulls again",
        )
    made = attributes.get("settings", {}).get("statistics", {})
    if not is_comparable(made, settings):
        return pd.DataFrame(), ("the archive's nulls were made with other settings; run nulls again",)
    nulls = null_table(archive).assign(surrogates=made["surrogates"])
    return nulls, outdated_input_remarks(archive, "nulls")


def stored_measured(archive: Archive, estimate: str) -> tuple[pd.DataFrame, IntermittencySettings | None]:
    """Return an archive's measured profiles for an estimate, and their settings, which are None if there are none."""
    attributes = _attributes(archive, "intermittency")
    if not attributes.get(COMPLETE, False) or attributes.get("estimate") != estimate:
        return pd.DataFrame(), None
    _, studied = failed_profiles(study_table(archive, "intermittency"))
    return studied.reset_index(drop=True), IntermittencySettings.model_validate(attributes["settings"])


def is_comparable(stored: object, settings: IntermittencySettings) -> bool:
    """Return whether stored settings give the same statistics: all must agree except seeds and numbers of draws."""
    own = settings.model_dump(mode="json")
    if not isinstance(stored, dict):
        return False
    free = {"seed", "draws", "block_draws", "surrogates", "groups"} | (ADDED_SETTINGS - stored.keys())
    return all(stored.get(key) == value for key, value in own.items() if key not in free)


def _attributes(archive: Archive, name: str) -> dict[str, Any]:
    return {str(key): value for key, value in archive[name].attrs.items()} if name in archive.children else {}


# The nulls' ceiling


@dataclass(frozen=True)
class NullFloor:
    """Magnitudes without turbulence, in the channel's unit.

    Attributes
    ----------
    ceiling : float
        Largest magnitude in the nulls.
    noise : float
        Root mean square due to sensor noise alone.
    nulls : int, optional
        Number of nulls that determine the ceiling; None if an earlier version of this program determined it.
    """

    ceiling: float
    noise: float
    nulls: int | None = None

    @property
    def decides(self) -> bool:
        """Return whether there are enough nulls for events to be judged by the ceiling."""
        return self.nulls is None or self.nulls >= MIN_NULLS


def null_floor(archive: Archive, estimate: str, settings: FastSettings) -> tuple[NullFloor | None, tuple[str, ...]]:
    """Return ceiling and noise of an archive's nulls of the same channel and high-pass, or None, and remarks."""
    own_noise = "events are ranked by each profile's own noise floor"
    attributes = _attributes(archive, "nulls")
    if not attributes.get(COMPLETE, False) or attributes.get("estimate") != estimate:
        return None, (f"there are no nulls of this estimate: {own_noise}; run the study nulls",)
    made = IntermittencySettings.model_validate(attributes["settings"]["statistics"])
    if (made.channel, made.cutoff) != (settings.channel, settings.cutoff):
        return None, (f"the archive's nulls are of another channel or high-pass: {own_noise}",)
    ensembles = Ensembles(pd.DataFrame(), null_table(archive), made)
    if not np.isfinite(ensembles.ceiling):
        return None, (f"none of the archive's nulls has statistics, so there is no ceiling: {own_noise}",)
    noise = ensembles.family(NOISE_ONLY)
    floor = noise if len(noise) else ensembles.artefacts
    limits = NullFloor(ensembles.ceiling, float(floor["rms"].median()), ensembles.ceiling_count)
    if limits.decides:
        return limits, ()
    return limits, (
        f"the events cannot be judged: the ceiling is that of {limits.nulls} nulls without any disturbance, and "
        f"{MIN_NULLS} are needed; errors of the hull alone may exceed it in every profile. The list is a ranking only; "
        "run the study nulls without `quick`",
    )


def finite(column: pd.Series) -> Array:
    """Return the finite values of a column."""
    values: Array = column.to_numpy(dtype=np.float64)
    return values[np.isfinite(values)]
