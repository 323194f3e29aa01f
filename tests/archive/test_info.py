"""Opening and describing an archive."""

import math
import re
import shutil

import numpy as np
import pytest
from click.testing import CliRunner
from support.archives import put_profile, put_table_rows

from gliderhpc.archive.mission import describe, open_mission
from gliderhpc.cli.archive import info
from gliderhpc.errors import InputError
from gliderhpc.platform import read_platform
from gliderhpc.store_schema import SCHEMA_VERSION, consolidate, create_archive, set_attributes

SIZES = {"sample": 20, "record": 5, "window": 3, "segment": 1}


@pytest.fixture
def archive(tmp_path):
    path = tmp_path / "mission.zarr"
    attributes = {
        "mission": "sea trial",
        "platform": read_platform("petrel-l").model_dump(mode="json"),
        "engine": "scipy",
        "settings": {"step": 0.1, "window": {"length": 30.0}},
        "software_version": "0.1.0",
    }
    create_archive(path, [1, 2, 3, 4], SIZES, attributes)
    return path


def _fill(path) -> None:
    put_table_rows(
        path,
        {
            0: {
                "status": "done",
                "dac_north": 0.1,
                "dac_east": 0.0,
                "start_time": np.datetime64("2023-04-01"),
                "run_seconds": 2.0,
            },
            1: {
                "status": "done",
                "dac_north": 0.3,
                "dac_east": -0.2,
                "start_time": np.datetime64("2023-04-02"),
                "duration": 5400.0,
                "run_seconds": 3.0,
            },
            2: {"status": "failed", "message": "pitch is [missing] from 10:00 on"},
            3: {"status": "done", "message": "no fixes around it, so no current"},
        },
    )


def test_open_mission_is_lazy(archive):
    put_profile(archive, 1, "series", {"B_cr": np.ones(20)})
    with open_mission(archive) as tree:
        assert tree["series"].ds.B_cr.chunks is not None
        assert float(tree["series"].ds.B_cr.sel(profile=2).sum()) == 20.0


def test_describe(archive):
    _fill(archive)
    summary = describe(archive)
    assert summary.statuses == {"pending": 0, "done": 3, "failed": 1}
    assert list(summary.messages) == [3, 4]
    assert summary.groups["series"] == {"profile": 4, "sample": 20}
    assert summary.groups["/"] == {"profile": 4}
    assert summary.current.count == 2
    assert summary.current.north == pytest.approx(0.2)
    assert summary.run_seconds == 5.0
    assert summary.last_time == np.datetime64("2023-04-02") + np.timedelta64(90, "m")


def test_describe_an_empty_archive(archive):
    summary = describe(archive)
    assert summary.statuses["pending"] == 4
    assert summary.current.count == 0
    assert math.isnan(summary.current.north)
    assert np.isnat(summary.first_time)


def test_info_prints_all_of_it(archive):
    _fill(archive)
    result = CliRunner(env={"COLUMNS": "200"}).invoke(info, [str(archive)])
    assert result.exit_code == 0, result.output
    for text in (
        "sea trial",
        "petrel-l",
        "scipy",
        "3 done, 1 failed",
        "2023-04-01T00:00:00Z",
        "+0.200 m/s north, -0.100 m/s east (median of 2 profiles, from the adjoint)",
        "window.length",
        "profile 4, sample 20",
        "pitch is [missing] from 10:00 on",
    ):
        assert text in result.output


def test_info_of_an_empty_archive(archive):
    result = CliRunner().invoke(info, [str(archive)])
    assert result.exit_code == 0, result.output
    assert "4 pending" in result.output


@pytest.mark.damages_archive
def test_only_our_archives_open(tmp_path, archive):
    with pytest.raises(InputError, match=r"absent\.zarr: no such archive"):
        open_mission(tmp_path / "absent.zarr")
    with pytest.raises(InputError, match=r"not an archive of gliderhpc; give the folder .* wrote"):
        open_mission(tmp_path)
    (tmp_path / "records.nc").write_bytes(b"CDF")
    with pytest.raises(InputError, match=r"a file, not an archive of gliderhpc; give the folder .* makes from records"):
        open_mission(tmp_path / "records.nc")
    set_attributes(archive, {"schema_version": "99.0"})
    with pytest.raises(InputError, match=rf"version 99\.0, but this program reads {re.escape(SCHEMA_VERSION)}"):
        open_mission(archive)


@pytest.mark.damages_archive
def test_an_archive_of_another_version_is_not_called_damaged(archive):
    """Variables of this version that an older archive lacks are no damage that a resumed run could not mend."""
    _fill(archive)
    set_attributes(archive, {"schema_version": "1.0"})
    shutil.rmtree(archive / "dac_north_std")
    consolidate(archive)
    result = CliRunner().invoke(info, [str(archive)])
    assert result.exit_code == 0, result.output
    assert "it can be opened, studied and reported, but not resumed or appended to" in result.stderr
    assert "damaged" not in result.stderr
