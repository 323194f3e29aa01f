"""The synthetic mission: gliders flown through worlds whose disturbances and currents are known."""

from gliderhpc.observations.synthetic.disturbance import Impulse
from gliderhpc.observations.synthetic.mission import MissionSummary, ProfileSummary, check_place, simulate_mission
from gliderhpc.observations.synthetic.ocean_model_file import write_ocean_model
from gliderhpc.observations.synthetic.profile import ProfileTruth, simulate_profile
from gliderhpc.observations.synthetic.scenario import (
    Scenario,
    load_scenario,
    read_scenario,
    shipped_scenarios,
)
from gliderhpc.observations.synthetic.truth_file import most_impulses, read_profile_truth, truth_path

__all__ = [
    "Impulse",
    "MissionSummary",
    "ProfileSummary",
    "ProfileTruth",
    "Scenario",
    "check_place",
    "load_scenario",
    "most_impulses",
    "read_profile_truth",
    "read_scenario",
    "shipped_scenarios",
    "simulate_mission",
    "simulate_profile",
    "truth_path",
    "write_ocean_model",
]
