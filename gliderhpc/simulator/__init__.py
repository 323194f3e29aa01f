"""Synthetic missions: simulated glider flights with known disturbances and currents."""

from gliderhpc.simulator.disturbance import Impulse
from gliderhpc.simulator.mission import (
    MissionSummary,
    ProfileSummary,
    check_mission_path,
    simulate_mission,
    write_ocean_model,
)
from gliderhpc.simulator.profile import ProfileTruth, simulate_profile
from gliderhpc.simulator.scenario import (
    Scenario,
    load_scenario,
    read_scenario,
    shipped_scenarios,
)

__all__ = [
    "Impulse",
    "MissionSummary",
    "ProfileSummary",
    "ProfileTruth",
    "Scenario",
    "check_mission_path",
    "load_scenario",
    "read_scenario",
    "shipped_scenarios",
    "simulate_mission",
    "simulate_profile",
    "write_ocean_model",
]
