"""The depth-resolved current of one profile, where the study of the currents holds it."""

from typing import Any

import numpy as np
import xarray as xr

from gliderhpc.archive.profile import read_profile_data
from gliderhpc.report.page.content import Block, Commands, Grid, Notice, Picture
from gliderhpc.report.page.mission_table import heading
from gliderhpc.report.page.reproduction import study_command
from gliderhpc.report.studies.currents.figure_7 import figure_7, nothing_retrieved
from gliderhpc.report.studies.registry import studies_in
from gliderhpc.store_schema.place import Place
from gliderhpc.studies.currents.settings import DepthResolvedSettings
from gliderhpc.studies.provenance import provenance_of

STUDY = "currents"

_CAPTION = (
    "Depth-resolved current (the publication's Figure 7): the shear-sensitive part that the yaw moment tells, over "
    "the depth-averaged current, with two standard deviations by drawn coefficients and identification noise. It is "
    "a lower bound in a band of vertical scales, named below the panels, and not the absolute profile: slow shear "
    "does not show."
)


def depth_resolved_blocks(archive: xr.DataTree, number: int, place: Place, stem: str) -> tuple[Block, ...]:
    """Figure 7 and the bins of a profile, or why there is none."""
    if STUDY not in studies_in(archive) or number not in provenance_of(archive, STUDY).profiles:
        command = study_command(STUDY, archive, place)
        return (Commands("The archive holds no depth-resolved current of this profile. This makes it:", (command,)),)
    bins = archive[STUDY].to_dataset().sel(profile=number).load()
    if not np.isfinite(bins["both_shear_north"].values).any():
        return (Notice(nothing_retrieved(bins)),)
    made = provenance_of(archive, STUDY)
    figure = figure_7(
        archive, read_profile_data(archive, number, made.estimate), DepthResolvedSettings.model_validate(made.settings)
    )
    shown = (
        f"Current of profile {number} by depth, its shear-sensitive part on dive and climb, and the track from above."
    )
    return (
        Picture(f"{stem}_current_by_depth", _CAPTION, shown, figure),
        Grid(f"{stem}_current_by_depth", "The bins of depth that have a value.", _bin_rows(bins)),
    )


def _bin_rows(bins: xr.Dataset) -> list[dict[str, Any]]:
    """One row a bin of depth with a value, all of the study's columns by bin."""
    names = [str(name) for name, variable in bins.data_vars.items() if variable.dims == ("bin",)]
    columns = {heading(bins[name]): bins[name].values for name in names}
    known = np.isfinite(bins["both_shear_north"].values)
    return [{name: values[index].item() for name, values in columns.items()} for index in np.flatnonzero(known)]
