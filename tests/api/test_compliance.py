"""Output of `gliderhpc currents` before the IOOS compliance checker, where that is installed."""

import json
import shutil
import subprocess

import pytest
from support.glides import Glide, mission
from support.missions import program

CHECKER = shutil.which("compliance-checker")


@pytest.mark.skipif(CHECKER is None, reason="the program compliance-checker is not installed")
def test_currents_have_no_error_against_cf_1_11(tmp_path):
    mission(Glide()).to_netcdf(tmp_path / "records.nc")
    answer = program("currents", tmp_path / "records.nc", tmp_path / "currents.nc")
    assert answer.status == 0, answer.err
    report = tmp_path / "report.json"
    subprocess.run(
        [str(CHECKER), "-t", "cf:1.11", "-f", "json", "-o", str(report), str(tmp_path / "currents.nc")],
        check=False, capture_output=True, timeout=300,
    )  # fmt: skip
    (found,) = json.loads(report.read_text()).values()
    failed = [item["msgs"] for item in found["high_priorities"] if item["value"][0] < item["value"][1]]
    assert found["possible_points"] > 0
    assert found["high_count"] == 0, failed
