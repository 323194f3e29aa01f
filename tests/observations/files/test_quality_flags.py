"""Quality flags: values flagged bad or missing are not used, by the file's own meanings or the Argo convention."""

import numpy as np
import pytest
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.files.foreign import ForeignFile
from gliderhpc.observations.files.quality_flags import find_rejected
from gliderhpc.observations.navigation.columns import NavigationColumns

QARTOD = {"flag_values": np.array([1, 2, 3, 4, 9], "i1"), "flag_meanings": "GOOD UNKNOWN SUSPECT FAIL MISSING"}
SEAGLIDER = {"flag_values": "0 1 3 4", "flag_meanings": "QC_NO_CHANGE QC_GOOD QC_PROBABLY_BAD QC_BAD"}


def _file(flags, *, name="PITCH_QC", values=(1.0, 2.0, 3.0, 4.0), **attributes) -> xr.Dataset:
    ancillary = {} if name == "PITCH_QC" else {"ancillary_variables": f"OTHER {name}"}
    return xr.Dataset({"PITCH": ("n", np.array(values), ancillary), name: ("n", np.asarray(flags), attributes)})


@pytest.mark.parametrize(
    ("dataset", "lost"),
    [
        (_file(np.array([1, 3, 4, 9], "i1")), [False, True, True, True]),
        (_file(np.array([0, 2, 5, 8], "i1")), [False] * 4),
        (_file(np.array([1, 3, 4, 9], "i1"), **QARTOD), [False, False, True, True]),
        (_file(np.array([1.0, 3.0, 4.0, 0.0], "f4"), **SEAGLIDER), [False, True, True, False]),
        (_file(np.array([b"1", b"4", b" ", b"0"], "S1")), [False, True, False, False]),
        (_file(np.array([1, 4, 1, 1], "i1"), name="checks", **QARTOD), [False, True, False, False]),
        (_file(np.array([1, 4, 1, 1], "i1"), name="pitch_qc"), [False, True, False, False]),
        (_file(np.array([9, 9, 9, 9], "i1")), [False] * 4),
        (_file(np.array([0, 0, 0, 0], "i1")), [False] * 4),
        (_file(np.array([1, 4, 1, 1], "i1"), flag_masks=np.array([1, 4], "i1")), [False] * 4),
        (_file(np.array([1, 1, 1, 4], "i1"), values=(1.0, 2.0, 3.0, np.nan)), [False] * 4),
    ],
    ids=["Argo", "no bad ones", "QARTOD", "Seaglider", "characters", "ancillary", "lower case", "all missing",
         "no QC", "masks", "no value"],
)  # fmt: skip
def test_values_flagged_bad_are_found_in_a_dataset_and_in_a_file(dataset, lost, tmp_path):
    dataset.to_netcdf(tmp_path / "file.nc")
    with ForeignFile(tmp_path / "file.nc") as file, xr.open_dataset(tmp_path / "file.nc") as stored:
        for columns in (NavigationColumns(dataset, "dataset"), file, NavigationColumns(stored, "stored")):
            found = find_rejected(columns, ["PITCH"])
            np.testing.assert_array_equal(found.masks.get("PITCH", np.zeros(4, dtype=bool)), lost)
            assert (f"{sum(lost)} of PITCH (" in found.remark) == any(lost)


def test_flags_of_a_position_are_those_of_latitude_and_longitude():
    flags = {"POSITION_GPS_QC": ("n", np.array([1, 4], "i1"))}
    places = {name: ("n", np.ones(2)) for name in ("LATITUDE_GPS", "LONGITUDE_GPS")}
    found = find_rejected(NavigationColumns(xr.Dataset(places | flags), "dataset"), places)
    assert {name: mask.tolist() for name, mask in found.masks.items()} == {
        "LATITUDE_GPS": [False, True],
        "LONGITUDE_GPS": [False, True],
    }


def test_a_needed_variable_of_which_every_value_is_bad_is_refused():
    columns = NavigationColumns(_file(np.array([4, 3, 4, 4], "i1")), "glider.nc")
    with pytest.raises(InputError, match=r"glider.nc: every value of PITCH is flagged bad or missing by PITCH_QC"):
        find_rejected(columns, ["PITCH"], {"PITCH"})
    assert find_rejected(columns, ["PITCH"]).masks["PITCH"].all()
