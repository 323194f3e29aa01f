"""Depths that are positive up are refused with the remedy, since no importer finds a dive in them."""

import numpy as np
import pytest
from support.glides import Glide, mission
from support.missions import program
from support.observation_files import edited
from support.seaexplorer_files import NAVIGATION, edit, write_mission
from support.seaglider_files import depths, write_dive
from support.slocum_files import flight, write_netcdf

from gliderhpc.api.currents import currents
from gliderhpc.errors import InputError
from gliderhpc.observations import open_observations
from gliderhpc.observations.checks.sign_checks import refuse_negative_depth

DEPTH = NAVIGATION.split(";").index("Depth")


def reversed_depth(lines):
    rows = [line.split(";") for line in lines[1:]]
    for row in rows:
        row[DEPTH] = str(-float(row[DEPTH]))
    return [lines[0], *(";".join(row) for row in rows)]


def test_a_seaexplorer_s_depth_that_is_positive_up_is_refused(tmp_path):
    folder = write_mission(tmp_path / "raw")
    for cycle in (5, 6, 7, 8):
        edit(folder, cycle, reversed_depth)
    answer = program("import", "seaexplorer", folder, tmp_path / "out.nc")
    assert answer.status == 2
    assert f"{folder}: Depth is negative under water (-102 m at the deepest); make it positive down" in answer.line
    assert not (tmp_path / "out.nc").exists()


def test_a_seaglider_s_depth_that_is_positive_up_is_refused(tmp_path):
    paths = [write_dive(tmp_path, dive, columns=True, depth=-depths(100.0)) for dive in (1, 2)]
    answer = program("import", "seaglider", *paths, tmp_path / "out.nc")
    assert answer.status == 2
    assert "no dive can be used; 2 of 2: dive 1: " in answer.line
    assert "p0990001.nc: depth is negative under water (-100 m at the deepest); make it positive down" in answer.line


def test_a_slocum_s_depth_that_is_positive_up_is_refused(tmp_path):
    flown = flight()
    flown["m_depth"] = -flown["m_depth"]
    path = write_netcdf(tmp_path / "a.nc", flown)
    answer = program("import", "slocum", path, tmp_path / "out.nc")
    assert answer.status == 2
    assert f"{path}: m_depth is negative under water (-60 m at the deepest); make it positive down" in answer.line


@pytest.mark.parametrize(
    ("depth", "refused"),
    [
        (np.linspace(0.0, -50.0, 100), True),
        (np.linspace(0.0, -9.0, 100), False),
        (np.concatenate([np.full(5, -300.0), np.linspace(0.0, 8.0, 100)]), False),
        (np.concatenate([np.full(20, -300.0), np.linspace(0.0, 80.0, 100)]), False),
        (np.full(9, np.nan), False),
    ],
    ids=["up", "shallow", "junk", "few", "missing"],
)
def test_only_a_reversed_sign_is_refused(depth, refused):
    if not refused:
        refuse_negative_depth(depth, "file", "depth")
        return
    with pytest.raises(InputError, match=r"^file: depth is negative under water \(-50 m"):
        refuse_negative_depth(depth, "file", "depth")


def test_a_positive_depth_that_is_declared_positive_up_is_refused(tmp_path):
    path = edited(tmp_path, lambda dataset: dataset["depth"].attrs.update(positive="up"))
    fault = "depth is positive under water, but declared positive up; correct its attribute positive"
    with pytest.raises(InputError, match=fault):
        open_observations(path)
    records = mission(Glide())
    records["depth"].attrs["positive"] = "up"
    with pytest.raises(InputError, match=fault):
        currents(records)
