"""A file that has not changed is read once, and the import equals that of all files read afresh."""

import errno
import functools
import hashlib
import pickle
import shutil
from collections import Counter
from pathlib import Path

import pytest
from support.seaexplorer_files import PAYLOAD, write_mission
from support.seaglider_files import write_dive, write_og1
from support.slocum_files import flight, science, write_binary, write_netcdf

from gliderhpc.observations.files.stored_reads import StoredReads
from gliderhpc.watch.records import FileImport


def _seaglider(folder: Path) -> list[Path]:
    return [write_dive(folder, dive, columns=dive != 2) for dive in (1, 2, 3)]


def _seaexplorer(folder: Path) -> list[Path]:
    return sorted(write_mission(folder).iterdir())


def _og1(folder: Path) -> list[Path]:
    folder.mkdir()
    return [write_og1(folder / f"part{dive}.nc", (dive,)) for dive in (1, 2, 3)]


def _slocum(folder: Path) -> list[Path]:
    folder.mkdir()
    return [write_netcdf(folder / f"part{n}.nc", flight(n), science(n)) for n in (0, 1, 2)]


def _slocum_binary(folder: Path) -> list[Path]:
    pytest.importorskip("dbdreader")
    folder.mkdir()
    names = [f"unit-2024-100-0-{n}" for n in (0, 1, 2)]
    return [write_binary(folder / f"{name}.dbd", flight(n), name=name) for n, name in enumerate(names)]


def _observations(folder: Path) -> list[Path]:
    """One observation file a dive."""
    folder.mkdir()
    found = [folder / f"dive{dive}.nc" for dive in (1, 2, 3)]
    for dive, path in enumerate(found, start=1):
        FileImport(None, {}).import_files([write_dive(folder.with_name(f"of{dive}"), dive, columns=True)], path)
    return found


class _CountedReads:
    """Stored reads that count the files opened."""

    def __init__(self, folder: Path, paths: list[Path]) -> None:
        folder.mkdir(exist_ok=True)
        digests = {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}
        self.stored, self.opened = StoredReads(folder, digests), Counter()

    def __call__(self, read, path, *arguments):
        @functools.wraps(read)
        def counted(path, *arguments):
            self.opened[path.name] += 1
            return read(path, *arguments)

        return self.stored(counted, path, *arguments)


def _imported(paths: list[Path], out: Path, folder: Path) -> Counter[str]:
    """Import files with stored reads; how often each was opened."""
    reads = _CountedReads(folder, paths)
    assert FileImport(None, {}).import_files(paths, out, reads) == {}
    reads.stored.remove_unused()
    return reads.opened


@pytest.mark.parametrize("write", [_seaglider, _seaexplorer, _og1, _slocum, _slocum_binary, _observations])
def test_only_new_files_are_opened_and_the_records_are_those_of_all_files(write, tmp_path):
    paths = write(tmp_path / "files")
    folder, out, whole = tmp_path / "read", tmp_path / "out.nc", tmp_path / "whole.nc"
    assert set(_imported(paths[:-1], out, folder)) == {path.name for path in paths[:-1]}
    assert set(_imported(paths, out, folder)) == {paths[-1].name}
    assert _imported(paths, out, folder) == {}
    assert FileImport(None, {}).import_files(paths, whole) == {}
    assert out.read_bytes() == whole.read_bytes()


def test_a_payload_file_is_opened_when_it_comes(tmp_path):
    folder = write_mission(tmp_path / "m")
    _imported(sorted(folder.iterdir()), tmp_path / "out.nc", tmp_path / "read")
    text = PAYLOAD + "\n05/07/2023 10:10:00.000;10.0;3.5;20.0;\n"
    (folder / "sea099.3.pld1.sub.5").write_text(text, "utf-8")
    opened = _imported(sorted(folder.iterdir()), tmp_path / "out.nc", tmp_path / "read")
    assert set(opened) == {"sea099.3.pld1.sub.5"}


def test_a_changed_file_and_a_damaged_result_are_read_again(tmp_path):
    paths, folder, out = _seaglider(tmp_path / "files"), tmp_path / "read", tmp_path / "out.nc"
    _imported(paths, out, folder)
    stored = sorted(folder.iterdir())
    write_dive(tmp_path / "other", 3, columns=False)
    shutil.copy(tmp_path / "other" / paths[2].name, paths[2])
    assert set(_imported(paths, out, folder)) == {paths[2].name}
    # What the file held before is removed, so that the folder does not grow.
    assert len(list(folder.iterdir())) == len(stored)
    before = out.read_bytes()
    for path in folder.iterdir():
        path.write_bytes(path.read_bytes()[:-1])
    assert set(_imported(paths, out, folder)) == {path.name for path in paths}
    assert out.read_bytes() == before


class _Trap:
    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):
        return Path.touch, (self.mark,)


def test_a_stored_result_cannot_run_code(tmp_path):
    (path, *_), folder, mark = _seaglider(tmp_path / "files"), tmp_path / "read", tmp_path / "mark"
    _imported([path], tmp_path / "out.nc", folder)
    trap = pickle.dumps((_Trap(mark),))
    for stored in folder.iterdir():
        stored.write_bytes(hashlib.sha256(trap).digest() + trap)
    assert set(_imported([path], tmp_path / "out.nc", folder)) == {path.name}
    assert not mark.exists()
    # The trap would have sprung.
    pickle.loads(trap)
    assert mark.exists()


def test_a_failed_read_is_tried_again(tmp_path):
    path, answers = tmp_path / "file", iter([ValueError("not yet"), 7])
    path.write_text("text")
    reads = StoredReads(tmp_path, {path: "digest"})

    def read(_: Path) -> int:
        answer = next(answers)
        if isinstance(answer, Exception):
            raise answer
        return answer

    with pytest.raises(ValueError, match="not yet"):
        reads(read, path)
    assert reads(read, path) == 7
    assert reads(read, path) == 7
    assert reads(lambda _: 8, tmp_path / "other") == 8


def test_a_result_that_cannot_be_stored_is_still_a_result(tmp_path, caplog):
    """The disk is full: the file is read again next time, and is not at fault."""
    path = tmp_path / "file"
    path.write_text("text")
    reads = StoredReads(tmp_path / "no such folder", {path: "digest"})
    assert reads(lambda _: 7, path) == 7
    assert "the file is read again next time" in caplog.text


def test_a_result_that_does_not_fit_onto_the_disk_is_still_a_result(tmp_path, caplog, monkeypatch):
    path = tmp_path / "file"
    path.write_text("text")
    reads = StoredReads(tmp_path, {path: "digest"})

    def fill(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", fill)
    assert reads(lambda _: 7, path) == 7
    assert "cannot be written: No space left on device; the file is read again next time" in caplog.text


def test_a_result_of_classes_that_this_python_lacks_is_read_again(tmp_path):
    path = tmp_path / "file"
    path.write_text("text")
    reads = StoredReads(tmp_path, {path: "digest"})
    assert reads(_seven, path) == 7
    (stored,) = (one for one in tmp_path.iterdir() if one != path)
    foreign = b"cgliderhpc.observations.no_such_module\nThing\n."
    stored.write_bytes(hashlib.sha256(foreign).digest() + foreign)
    assert reads(_seven, path) == 7


def _seven(_: Path) -> int:
    return 7
