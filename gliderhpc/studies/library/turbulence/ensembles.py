"""The measured profiles and the nulls they are held against."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.store_schema.studies import COMPLETE
from gliderhpc.studies.archived import as_cells, failed_profiles, study_table
from gliderhpc.studies.library.turbulence.settings import FastSettings, IntermittencySettings
from gliderhpc.studies.library.turbulence.statistics import ROUNDING

FAMILIES = {
    "noise_only": "noise only",
    "model_error": "model error",
    "gaussian": "Gaussian disturbance of the measured spectrum",
}
"""The kinds of nulls, and what they are called."""

ARTEFACTS = ("noise_only", "model_error")
"""Those that make the ceiling: what the pipeline invents without any disturbance. A Gaussian one is none of these."""


@dataclass(frozen=True, eq=False)
class Ensembles:
    """What a verdict is made from.

    Attributes
    ----------
    measured : pandas.DataFrame
        A row a profile, as group ``intermittency`` has them.
    nulls : pandas.DataFrame
        A row a realisation, as group ``nulls`` has them; empty where there are none.
    settings : IntermittencySettings
        That both were made with.
    """

    measured: pd.DataFrame
    nulls: pd.DataFrame
    settings: IntermittencySettings

    def family(self, name: str) -> pd.DataFrame:
        """Realisations of a kind that have statistics."""
        if self.nulls.empty:
            return self.nulls
        return pd.DataFrame(self.nulls.loc[(self.nulls["family"] == name) & (self.nulls["rms"] > ROUNDING)])

    @property
    def artefacts(self) -> pd.DataFrame:
        """Realisations without any disturbance that have statistics."""
        return pd.concat([self.family(name) for name in ARTEFACTS]) if len(self.nulls) else self.nulls

    @property
    def ceiling(self) -> float:
        """Largest magnitude that any artefact reaches, in the channel's unit; NaN without nulls."""
        return float(self.artefacts["peak"].max()) if len(self.artefacts) else float("nan")


def null_table(archive: xr.DataTree) -> pd.DataFrame:
    """Return the table of an archive's nulls, a row a realisation."""
    group = archive["nulls"].to_dataset()
    columns = [str(name) for name, variable in group.data_vars.items() if variable.dims == ("null",)]
    return pd.DataFrame({name: as_cells(group[name].values) for name in columns})


def stored_nulls(
    archive: xr.DataTree, estimate: str, settings: IntermittencySettings
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Nulls that an archive holds for an estimate and settings, none where it holds others, and what to say of it."""
    attributes = _attributes(archive, "nulls")
    if not attributes.get(COMPLETE, False):
        return pd.DataFrame(), ("there are no nulls to hold the amplitudes against; run the study nulls",)
    if attributes.get("estimate") != estimate:
        return pd.DataFrame(), (
            f"the archive's nulls are of the {attributes.get('estimate')} estimate; run nulls anew",
        )
    if not alike(attributes.get("settings", {}).get("statistics", {}), settings):
        return pd.DataFrame(), ("the archive's nulls were made with other settings; run nulls anew",)
    return null_table(archive), ()


def stored_measured(archive: xr.DataTree, estimate: str) -> tuple[pd.DataFrame, IntermittencySettings | None]:
    """Table of the measured profiles that an archive holds for an estimate, and its settings; None without one."""
    attributes = _attributes(archive, "intermittency")
    if not attributes.get(COMPLETE, False) or attributes.get("estimate") != estimate:
        return pd.DataFrame(), None
    _, studied = failed_profiles(study_table(archive, "intermittency"))
    return studied.reset_index(drop=True), IntermittencySettings.model_validate(attributes["settings"])


def _attributes(archive: xr.DataTree, name: str) -> dict[str, Any]:
    return {str(key): value for key, value in archive[name].attrs.items()} if name in archive.children else {}


def alike(stored: object, settings: IntermittencySettings) -> bool:
    """Whether stored settings give statistics that can stand beside these: all but seeds and sizes of draws."""
    own = settings.model_dump(mode="json")
    free = {"seed", "draws", "block_draws", "surrogates", "groups"}
    return isinstance(stored, dict) and all(stored.get(key) == value for key, value in own.items() if key not in free)


_BY_OWN_NOISE = "events are ranked by each profile's own noise floor"


@dataclass(frozen=True)
class NullFloor:
    """What the pipeline reaches without turbulence: the nulls' ceiling, and the noise that sensors alone leave."""

    ceiling: float
    noise: float


def null_floor(archive: xr.DataTree, estimate: str, settings: FastSettings) -> tuple[NullFloor | None, tuple[str, ...]]:
    """Ceiling and noise of an archive's nulls of the same channel and high-pass, or None, and what to say of it."""
    attributes = _attributes(archive, "nulls")
    if not attributes.get(COMPLETE, False) or attributes.get("estimate") != estimate:
        return None, (f"there are no nulls of this estimate: {_BY_OWN_NOISE}; run the study nulls",)
    made = IntermittencySettings.model_validate(attributes["settings"]["statistics"])
    if (made.channel, made.cutoff) != (settings.channel, settings.cutoff):
        return None, (f"the archive's nulls are of another channel or high-pass: {_BY_OWN_NOISE}",)
    ensembles = Ensembles(pd.DataFrame(), null_table(archive), made)
    if not np.isfinite(ensembles.ceiling):
        return None, (f"none of the archive's nulls has statistics, so there is no ceiling: {_BY_OWN_NOISE}",)
    noise = ensembles.family("noise_only")
    own = noise if len(noise) else ensembles.artefacts
    return NullFloor(ensembles.ceiling, float(own["rms"].median())), ()
