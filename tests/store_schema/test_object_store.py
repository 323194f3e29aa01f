"""Archive in an object store, over the S3 protocol of a server process on loopback."""

import hashlib
import os
import urllib.request

import pytest
import xarray as xr
from support.missions import WHOLE, archive_bytes, program
from support.object_stores import KEYS, make_bucket, s3_server

from gliderhpc.archive.mission import open_mission
from gliderhpc.errors import InputError
from gliderhpc.mission.lock import locked
from gliderhpc.store_schema import ArchiveRows, create_study, finish_study, read_commits, restored_on_error
from gliderhpc.store_schema.location import store_at

obstore = pytest.importorskip("obstore", reason="the extra 'cloud' is not installed")
pytest.importorskip("moto.server", reason="moto's server, the S3 server of these tests, is not installed")

pytestmark = [pytest.mark.compiled, pytest.mark.usefixtures("unchecked_records")]

BUCKET = "gliders"


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """Address of an S3 server."""
    with s3_server(tmp_path_factory.mktemp("s3")) as address:
        yield address


@pytest.fixture
def bucket(server, monkeypatch):
    """Address of an empty bucket, its server and keys in the environment as a user would have them."""
    for name, value in {**KEYS, "AWS_ENDPOINT_URL": server}.items():
        monkeypatch.setenv(name, value)
    urllib.request.urlopen(urllib.request.Request(f"{server}/moto-api/reset", method="POST")).close()
    return make_bucket(server, BUCKET)


def stored(address: str) -> dict[str, str]:
    """MD5 of every object below an address, except run times; a listing has it as the tag."""
    names = [one for batch in obstore.list(obstore.store.from_url(address)) for one in batch]
    timed = ("run_seconds/", "commits/marker/")
    return {one["path"]: one["e_tag"].strip('"') for one in names if not one["path"].startswith(timed)}


@pytest.mark.long
def test_a_mission_into_an_object_store(swift, swift_store, bucket):
    """The same chunks as on disk, found, checked, resumed and read there."""
    address = f"{bucket}/missions/swift.zarr"
    answer = program("run-mission", swift, *WHOLE, "--store", address)
    assert answer.status == 0, answer.err
    there = stored(address)
    assert there == {name: hashlib.md5(content).hexdigest() for name, content in archive_bytes(swift_store).items()}
    assert program("check", address, "--deep").status == 0
    assert program("info", address).status == 0
    assert program("compare", swift_store, address).status == 0
    with open_mission(address) as ours, xr.open_datatree(swift_store, engine="zarr") as theirs:
        xr.testing.assert_identical(ours["series"].ds.sel(profile=2).load(), theirs["series"].ds.sel(profile=2).load())
    with xr.open_datatree(store_at(address, read_only=True), engine="zarr") as alone:
        assert list(alone["status"].values) == ["done"] * 3

    obstore.delete(obstore.store.from_url(address), "series/B_cu/c.1.0")
    ArchiveRows(address).begin(2)
    answer = program("check", address, "--deep")
    assert answer.status == 1
    assert "profile 2, series/B_cu: the chunk is missing" in answer.out
    answer = program("run-mission", swift, *WHOLE, "--store", address, "--resume")
    assert answer.status == 0
    assert "1 profile is valid; to be computed: 1 damaged, 1 missing" in answer.err
    assert stored(address) == there
    assert set(read_commits(address)) == {0, 1, 2}


@pytest.mark.long
def test_an_archive_there_is_refused_and_replaced(swift, bucket):
    address = f"{bucket}/one.zarr"
    run = ("run-mission", swift, *WHOLE, "--store", address, "--profiles", "1")
    assert program(*run).status == 0
    answer = program(*run)
    assert answer.status == 2
    assert "this archive exists; finish it with --resume or start again with --overwrite" in answer.line
    assert program(*run[:-1], "2", "--overwrite").status == 0
    with open_mission(address) as tree:
        assert list(tree["profile"].values) == [2]
    _make_and_fail(address)


def _make_and_fail(address):
    """A study that ends in an error leaves its earlier results unchanged, here and on disk."""
    create_study(address, "vertical")
    finish_study(address, "vertical", {"run": 1})
    before = stored(address)

    def fail():
        create_study(address, "vertical", attributes={"run": 2})
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), restored_on_error(address, "vertical"):
        fail()
    assert stored(address) == before


def test_a_second_run_is_refused_by_a_conditional_put(swift, bucket):
    address = f"{bucket}/two.zarr"
    with locked(address):
        answer = program("run-mission", swift, *WHOLE, "--store", address)
        assert answer.status == 2
        assert f"two.zarr: another run is writing it (process {os.getpid()} on" in answer.err
    assert program("run-mission", swift, *WHOLE, "--store", address, "--profiles", "1").status == 0
    assert not any(name.endswith(".lock") for name in stored(bucket))


def test_an_address_that_nothing_answers_at(swift, bucket):
    answer = program("run-mission", swift, *WHOLE, "--store", "s4://nowhere/a.zarr")
    assert answer.status == 2
    assert "s4://nowhere: cannot be opened" in answer.err.splitlines()[-1]
    with pytest.raises(InputError, match="no such archive"):
        open_mission(f"{bucket}/absent.zarr")
