"""One profile inverted in memory: the job of a run on an archive that nobody else sees."""

import numpy as np
import xarray as xr

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.errors import ProfileError
from gliderhpc.estimation.preparation import check_seawater
from gliderhpc.estimation.profile import check_engine
from gliderhpc.mission.jobs import MissionWork, results_from
from gliderhpc.mission.planning import plan_mission
from gliderhpc.mission.run import archive_attributes
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations
from gliderhpc.platform import Platform
from gliderhpc.store_schema import create_archive, write_mission_table
from gliderhpc.store_schema.mission_groups import COMMITS
from gliderhpc.store_schema.place import place_in_memory


def invert_profile(
    observations: Observations, platform: Platform, settings: MissionSettings, number: int
) -> xr.DataTree:
    """Estimate one profile, and give what `gliderhpc.mission.run.run_mission` writes of it into an archive.

    Parameters
    ----------
    observations : Observations
        The open file.
    platform, settings : Platform, MissionSettings
        The hull and the settings.
    number : int
        Number of the profile.

    Returns
    -------
    xarray.DataTree
        The archive of a run on this profile alone, in memory, without the group of its commit markers: rows are as long
        as this profile.

    Raises
    ------
    ProfileError
        The profile cannot be estimated.
    InputError
        As `run_mission`.
    """
    check_engine(settings)
    check_seawater(platform, settings)
    plan = plan_mission(observations, settings, (number,))
    with place_in_memory() as place:
        create_archive(place, np.array([number]), plan.sizes, archive_attributes(observations, platform, settings))
        work = MissionWork(observations, platform, settings, str(place))
        (result,) = results_from(observations, work.job(((number, 0),), token=None))
        if result.row["status"] != "done":
            raise ProfileError(result.row["message"])
        write_mission_table(place, {0: result.row})
        with open_for_reading(place) as archive:
            tree = archive.load()
    return tree.drop_nodes(COMMITS)
