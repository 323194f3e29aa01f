"""Adopted depth-averaged current of reports and exports, and its label."""

import numpy as np
import pytest
import xarray as xr

from gliderhpc.archive.current import adopted_current

ROW = {
    "dac_north": 0.1, "dac_east": 0.2, "dac_north_std": 0.05, "dac_east_std": 0.06, "dac_covariance": 1e-4,
    "dac_north_smoothed": 0.3, "dac_east_smoothed": 0.4, "dac_north_smoothed_std": 0.01, "dac_east_smoothed_std": 0.02,
    "dac_smoothed_covariance": 2e-4,
}  # fmt: skip


def test_the_smoothed_current_is_adopted_with_its_own_covariance():
    current = adopted_current(ROW)
    found = (current.north, current.east, current.north_std, current.east_std, current.covariance)
    assert [float(value) for value in found] == [0.3, 0.4, 0.01, 0.02, 2e-4]
    assert (str(current.estimate), current.label) == ("smoothed", "from the smoother")


@pytest.mark.parametrize("missing", [{"dac_north_smoothed": np.nan}, {"dac_east_smoothed": np.nan}])
def test_the_adjoint_current_is_adopted_without_a_smoothed_one(missing):
    current = adopted_current(ROW | missing)
    found = (current.north, current.east, current.north_std, current.east_std, current.covariance)
    assert [float(value) for value in found] == [0.1, 0.2, 0.05, 0.06, 1e-4]
    assert (str(current.estimate), current.label) == ("adjoint", "from the adjoint")


def test_the_adjoint_current_is_adopted_in_archives_without_smoothed_columns():
    current = adopted_current({name: value for name, value in ROW.items() if "smoothed" not in name})
    assert (float(current.north), str(current.estimate)) == (0.1, "adjoint")
    assert str(adopted_current({}).estimate) == ""


def test_the_adopted_current_is_chosen_profile_by_profile():
    columns = {name: ("profile", np.full(4, value)) for name, value in ROW.items()}
    table = xr.Dataset(columns).copy(deep=True)
    table["dac_north_smoothed"][1:3] = np.nan
    table["dac_north"][2] = np.nan
    current = adopted_current(table)
    assert current.estimate.tolist() == ["smoothed", "adjoint", "", "smoothed"]
    assert current.known.tolist() == [True, True, False, True]
    np.testing.assert_array_equal(current.north_std[[0, 1]], [0.01, 0.05])
    assert current.label == "2 from the smoother, 1 from the adjoint"
