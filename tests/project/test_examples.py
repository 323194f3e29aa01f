"""Examples for other programs, where these are installed."""

import sys

import pytest
import xarray as xr
from support.glides import Glide, mission
from support.repository import REPOSITORY


def test_currents_are_a_step_of_a_pelagos_pipeline(tmp_path, monkeypatch):
    pytest.importorskip("pelagos_py.pipeline")
    monkeypatch.syspath_prepend(str(REPOSITORY / "examples"))
    monkeypatch.delitem(sys.modules, "pelagos_step", raising=False)
    import pelagos_step

    context = {"data": mission(Glide())}
    step = pelagos_step.DepthAveragedCurrents(
        "Depth-averaged currents", {"output_path": str(tmp_path / "currents.nc")}, context=context
    )
    found = step.run()["currents"]
    with xr.open_dataset(tmp_path / "currents.nc") as written:
        assert (written["dac_north"].values == found["dac_north"].values).all()
