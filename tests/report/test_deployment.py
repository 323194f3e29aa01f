"""Deployment file of `gliderhpc export og1`: its attributes, and refused content."""

import netCDF4
import pytest
from support.missions import program

from gliderhpc.errors import InputError
from gliderhpc.report.exports.deployment import read_deployment

PYGLIDER = """\
metadata:
  contributor_name: A. Name, B. Name
  keywords: [AUVS, Oceans]
  deployment_start: 2019-07-18
  wmo_id: 999999
  comment:
  summary: ' '
glider_devices:
  pressure: {make: Micron}
"""


def test_attributes_of_a_pyglider_file_are_texts(tmp_path):
    path = tmp_path / "deployment.yml"
    path.write_text(PYGLIDER)
    assert read_deployment(path) == {
        "contributor_name": "A. Name, B. Name",
        "keywords": "AUVS, Oceans",
        "deployment_start": "2019-07-18",
        "wmo_id": "999999",
    }


def test_a_flat_file_is_read_alike(tmp_path):
    path = tmp_path / "deployment.yaml"
    path.write_text("contributor_name: A. Name\nWMO_IDENTIFIER: '6801706'\n")
    assert read_deployment(path) == {"contributor_name": "A. Name", "WMO_IDENTIFIER": "6801706"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("- a\n- b\n", "contains no attributes"),
        ("metadata: none\n", "contains no attributes"),
        ("two words: x\n", "not a valid attribute name"),
        ("contributor: {name: A}\n", "contributor is not text"),
    ],
)
def test_a_file_without_attributes_is_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "deployment.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as refused:
        read_deployment(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.compiled
def test_options_take_precedence_over_the_file(brief_store, tmp_path):
    deployment, out = tmp_path / "deployment.yaml", tmp_path / "og1.nc"
    deployment.write_text("contributor_name: A. Name\ncontributor_role: Chief scientist\nWMO_IDENTIFIER: '6801706'\n")
    answer = program(
        "export", "og1", brief_store, out, "--deployment", deployment, "--attribute", "contributor_name=B. Name"
    )
    assert answer.status == 0, answer.err
    with netCDF4.Dataset(out) as file:
        assert file.contributor_name == "B. Name"
        assert file.contributor_role == "Chief scientist"
        assert file["WMO_IDENTIFIER"][...] == "6801706"


@pytest.mark.compiled
def test_a_missing_file_ends_with_status_2(brief_store, tmp_path):
    answer = program("export", "og1", brief_store, tmp_path / "og1.nc", "--deployment", tmp_path / "none.yaml")
    assert answer.status == 2
    assert "none.yaml" in answer.err
    assert not (tmp_path / "og1.nc").exists()
