"""Reading of binary Slocum files with the package dbdreader, an optional extra (it is under the GPL).

dbdreader does not check its files. A truncated header makes it read forever. Truncated data end in a record of junk. It
writes the sensor list of a file that contains one into the cache folder, under the name given in the header. Its
compiled code can end the process. Therefore this module checks the header first and discards the record at a
truncation, and dbdreader runs in its own process and folder.
"""

import importlib
import json
import locale
import os
import re
import selectors
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.files.file_content import describe_content
from gliderhpc.observations.importing.rows import Rows
from gliderhpc.observations.instruments.slocum_files import Sensor, conversion, is_compressed, rows_of_seconds
from gliderhpc.observations.records import FloatArray

READ_TIMEOUT = 120.0
"""Time limit for the reading of a file (s); an intact file of 100 MB takes a few seconds."""

_SCRIPT = Path(__file__).with_name("slocum_dbd_process.py")
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class DbdProcess:
    """A process that reads binary files one after the other until it is closed; it is restarted after it has died.

    Parameters
    ----------
    folder : Path
        An empty working folder, which is also searched for cache files.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._process: subprocess.Popen[str] | None = None

    def read(self, path: Path, plain: Path, names: Sequence[str]) -> tuple[dict[str, str], dict[str, FloatArray]]:
        """Read the units and the values ``(n,)`` of a file's sensors by name; sensors that it lacks are left out.

        Parameters
        ----------
        path : Path
            Path of the file in messages.
        plain : Path
            The same file, or a file with its decompressed content.
        names : sequence of str
            Names of the sensors.

        Raises
        ------
        InputError
            The library refuses the file, ends its process, or does not finish in time.
        """
        values = self._folder / "values.npy"
        request = {"path": str(plain), "cache": str(self._folder), "names": [*names], "values": str(values)}
        reply = self._ask(path, request)
        if "error" in reply:
            reason = str(reply["error"]).splitlines()[0]
            raise InputError(f"{path}: cannot be read, it may be damaged ({reason}); copy it again from the glider")
        held = [str(name) for name in reply["held"]]
        columns = dict(zip(held, np.load(values, allow_pickle=False), strict=True))
        return dict(zip(held, map(str, reply["units"]), strict=True)), columns

    def _ask(self, path: Path, request: dict[str, Any]) -> dict[str, Any]:
        process = self._process = self._process or self._started()
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(json.dumps(request) + "\n")
            process.stdin.flush()
            line = process.stdout.readline() if self._answered(process) else None
        except BrokenPipeError:
            line = ""
        if line is None:
            self.close()
            raise InputError(f"{path}: cannot be read within {READ_TIMEOUT:.0f} s; the file is damaged, leave it out")
        if not line:
            status = process.wait()
            self.close()
            raise InputError(
                f"{path}: cannot be read, dbdreader ended {_describe_exit(status)}; the file is damaged, leave it out"
            )
        reply: dict[str, Any] = json.loads(line)
        return reply

    def _started(self) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [sys.executable, "-P", str(_SCRIPT)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            encoding="utf-8",
            env={**os.environ, **_ONE_THREAD},
        )

    def _answered(self, process: "subprocess.Popen[str]") -> bool:
        """Return whether an answer, or the end of the process, arrives within the time limit."""
        assert process.stdout is not None
        with selectors.DefaultSelector() as selector:
            selector.register(process.stdout, selectors.EVENT_READ)
            return bool(selector.select(READ_TIMEOUT))

    def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        # This also closes the pipes.
        process.communicate()


def _describe_exit(status: int) -> str:
    return f"by signal {signal.Signals(-status).name}" if status < 0 else f"with status {status}"


_KEYS = (
    "num_ascii_tags", "encoding_ver", "sensor_list_crc", "sensor_list_factored", "total_num_sensors",
    "sensors_per_cycle", "state_bytes_per_cycle", "full_filename", "mission_name",
)  # fmt: skip
_COUNTS = ("num_ascii_tags", "total_num_sensors", "sensors_per_cycle", "state_bytes_per_cycle")
_STATES_IN_A_BYTE = 4
_ENCODING = "5"
_END = b"X"
"""Mark that the glider writes after the last record when it closes a file."""

_PADDING = 1 << 15
"""Zeros (bytes) added to a truncated file, more than a record of any glider has."""

_SENSOR = re.compile(rb"s: (?P<used>[TF]) +\d{1,6} +(?P<place>-?\d{1,6}) +(?P<size>[1248]) +\w+ +\S+\s*$")
"""A line of a list of sensors: use flag, number, place in the records, size (bytes), name, unit."""

_CRC = re.compile(r"[0-9a-fA-F]{1,8}")
"""Checksum of a list of sensors, which gives the name of its cache file."""

_COUNT = re.compile(r"\d{1,6}")

MAX_SEGMENT = 10.0 * 86_400.0
"""Maximum deviation of a time in a file from the median (s); a new file begins with every surfacing or mission."""

_COMPRESSED_CACHE = ".ccc"
_CACHE_FOLDERS = (".", "cac", "cache")


def cache_files(folder: Path) -> list[Path]:
    """Return the cache files in the places that are searched for the binary files of a folder."""
    places = (folder / name for name in _CACHE_FOLDERS)
    held = (path for place in places if place.is_dir() for path in sorted(place.iterdir()))
    return [path for path in held if path.suffix.lower() in (".cac", _COMPRESSED_CACHE)]


@dataclass(frozen=True, eq=False)
class Segment:
    """Content of one binary file.

    Attributes
    ----------
    name : str
        The glider's name of the segment, for example ``modena-2015-175-0-2``.
    rows : Rows
        Its records, in the units of the observation format.
    cut_short : bool
        True if the file is truncated.
    """

    name: str
    rows: Rows
    cut_short: bool

    @property
    def vehicle(self) -> str:
        """Name of the glider."""
        return re.sub(r"-\d+-\d+-\d+-\d+$", "", self.name)


class BinaryReader:
    """Reader of binary files, one at a time, until it is closed.

    Parameters
    ----------
    folder : Path
        An empty working folder for dbdreader.
    cache : Path or None
        Folder of the cache files; if None, the folder of each file and its folders ``cac`` and ``cache`` are searched.

    Raises
    ------
    InputError
        dbdreader is not installed, or the folder `cache` does not exist.
    """

    def __init__(self, folder: Path, cache: Path | None) -> None:
        if cache is not None and not cache.is_dir():
            raise InputError(f"{cache}: no such folder; give `cache` the folder that contains the *.cac files")
        self._library = _import_dbdreader()
        self._process = DbdProcess(folder)
        self._folder = folder
        self._cache = cache

    def close(self) -> None:
        """End dbdreader's process."""
        self._process.close()

    def read(self, path: Path, part: int, clock: str, sensors: Sequence[Sensor]) -> Segment:
        """Read the records of one file.

        Parameters
        ----------
        path : Path
            The file.
        part : int
            Number assigned to its rows.
        clock : str
            Name of the time sensor.
        sensors : sequence of Sensor
            Sensors to read; a sensor that the file does not have is NaN.

        Raises
        ------
        InputError
            The file or its cache file is missing or damaged, it is not a binary Slocum file, or it lacks the clock or
            a required sensor.
        """
        content, broken = self._content(path, compressed=is_compressed(path))
        header = _header(path, content)
        cut_short = broken or not content.endswith(_END)
        plain = self._plain(path, content, header, cut_short=cut_short)
        columns = self._columns(plain, path, clock, sensors)
        seconds = columns.pop(clock)
        stop = _incomplete_row(seconds) if cut_short else len(seconds)
        seconds = _without_strays(seconds[:stop])
        rows = rows_of_seconds(seconds, part, {name: values[:stop] for name, values in columns.items()})
        return Segment(header["full_filename"], rows, cut_short)

    def _content(self, path: Path, *, compressed: bool) -> tuple[bytes, bool]:
        """Return a file's decompressed content, and whether its last block is broken."""
        try:
            if not compressed:
                return path.read_bytes(), False
            blocks: list[bytes] = []
            with path.open("rb") as stream:
                decompressor = self._library.decompress.Decompressor(fp=stream)
                while (block := _next_block(decompressor)) is not None:
                    blocks.append(block)
                    if not block:
                        return b"".join(blocks), True
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
        return b"".join(blocks), False

    def _plain(self, path: Path, content: bytes, header: dict[str, str], *, cut_short: bool) -> Path:
        """Prepare the cache file and the decompressed content for dbdreader; return the path of the file to read.

        A truncated file is padded, since without its C extension dbdreader refuses one that ends within a record.
        """
        if header["sensor_list_factored"] == "1":
            self._fetch_cache(path, header)
        if not (is_compressed(path) or cut_short):
            return path
        plain = self._folder / "decompressed.dbd"
        plain.write_bytes(content + bytes(_PADDING if cut_short else 0))
        return plain

    def _fetch_cache(self, path: Path, header: dict[str, str]) -> None:
        """Copy a cache file to the folder that dbdreader searches."""
        wanted = self._folder / f"{header['sensor_list_crc'].lower()}.cac"
        if wanted.exists():
            return
        folders = [self._cache] if self._cache else [path.parent / name for name in _CACHE_FOLDERS]
        held = (file for folder in folders if folder.is_dir() for file in sorted(folder.iterdir()))
        for found in (file for file in held if file.is_file()):
            if found.stem.lower() == wanted.stem and found.suffix.lower() in (".cac", _COMPRESSED_CACHE):
                content, _ = self._content(found, compressed=found.suffix.lower() == _COMPRESSED_CACHE)
                if not _lists_sensors(content.split(b"\n"), header):
                    raise InputError(
                        f"{path}: its cache file {found} is truncated or not a list of sensors; copy it again"
                    )
                wanted.write_bytes(content)
                return
        where = str(self._cache) if self._cache else f"{path.parent} or its folders cac and cache"
        raise InputError(
            f"{path}: its cache file {wanted.name} is not in {where}; copy it from the glider's folder STATE/CACHE, "
            "or give its folder with `cache`"
        )

    def _columns(self, plain: Path, path: Path, clock: str, sensors: Sequence[Sensor]) -> dict[str, FloatArray]:
        units, values = self._process.read(path, plain, [clock, *(sensor.name for sensor in sensors)])
        held = [sensor for sensor in sensors if sensor.name in values]
        for sensor in sensors:
            if sensor.required and sensor not in held:
                raise InputError(
                    f"{path}: has no {sensor.name} ({sensor.required}); give the full record (*.dbd), or one whose "
                    "list of sensors contains it"
                )
        if clock not in values:
            raise InputError(
                f"{path}: has no {clock}, so its records have no time; give the full record (*.dbd, *.ebd)"
            )
        missing = np.full(len(values[clock]), np.nan)
        columns = {clock: values[clock]}
        for sensor in sensors:
            if sensor in held:
                convert = conversion(sensor.quantity, units[sensor.name], f"{path}: {sensor.name}")
                columns[sensor.name] = convert(values[sensor.name])
            else:
                columns[sensor.name] = missing
        return columns


def _incomplete_row(seconds: FloatArray) -> int:
    """Return the row of the incomplete record of a padded file: the last with a time, since the zeros have none."""
    return int(np.flatnonzero(np.isfinite(seconds))[-1]) if np.isfinite(seconds).any() else 0


def _without_strays(seconds: FloatArray) -> FloatArray:
    """Replace damaged times, which are further from the median than any segment is long, by NaN."""
    known = seconds[np.isfinite(seconds)]
    if not len(known):
        return seconds
    return np.where(np.abs(seconds - np.median(known)) <= MAX_SEGMENT, seconds, np.nan)


def _next_block(decompressor: Any) -> bytes | None:
    """Return the next block of a compressed file; None after the last block, empty if the block is broken."""
    try:
        block: bytes | None = next(decompressor.decompressed_blocks(n=1), None)
    except importlib.import_module("lz4.block").LZ4BlockError:
        return b""
    return block


def _header(path: Path, content: bytes) -> dict[str, str]:
    """Read the text header of a file, and check it and the list of sensors that may follow."""
    if not content.startswith(b"dbd_label:"):
        what = describe_content(path) or "is not a binary Slocum file (it does not begin with dbd_label); leave it out"
        raise InputError(f"{path}: {what}")
    text = content[:4096].decode("ascii", errors="replace").split("\n")
    pairs = (line.split(":", 1) for line in text if ":" in line)
    header = {pair[0]: pair[1].strip() for pair in pairs if pair[0] in _KEYS}
    if any(key not in header for key in _KEYS) or not _is_whole(content, header):
        raise InputError(f"{path}: is truncated within its header; copy it again from the glider")
    if header["encoding_ver"] != _ENCODING:
        raise InputError(f"{path}: has encoding {header['encoding_ver']}; only encoding {_ENCODING} can be read")
    if not _CRC.fullmatch(header["sensor_list_crc"]):
        raise InputError(
            f"{path}: its sensor_list_crc is not a hexadecimal checksum; the header is damaged, leave it out"
        )
    used, states = (int(header[key]) for key in ("sensors_per_cycle", "state_bytes_per_cycle"))
    if states != -(-used // _STATES_IN_A_BYTE):
        raise InputError(f"{path}: has {states} state bytes for {used} sensors; the header is damaged, leave it out")
    return header


def _is_whole(content: bytes, header: dict[str, str]) -> bool:
    """Return whether the text is complete: the header, and the list of sensors unless it is in a cache file."""
    if not all(_COUNT.fullmatch(header[key]) for key in _COUNTS):
        return False
    tags, sensors = int(header["num_ascii_tags"]), int(header["total_num_sensors"])
    if header["sensor_list_factored"] == "1":
        return len(content.split(b"\n", tags)) > tags
    return _lists_sensors(content.split(b"\n", tags + sensors)[tags:], header)


def _lists_sensors(lines: list[bytes], header: dict[str, str]) -> bool:
    """Return whether the lines begin with the number of sensors given in the header, followed by further content."""
    count, used = int(header["total_num_sensors"]), int(header["sensors_per_cycle"])
    if len(lines) <= count:
        return False
    sensors = [_SENSOR.match(line) for line in lines[:count]]
    places = [int(sensor["place"]) for sensor in sensors if sensor is not None and sensor["used"] == b"T"]
    return all(sensors) and sorted(places) == list(range(used))


def _import_dbdreader() -> Any:
    """Import dbdreader, and restore the locale that it changes."""
    before = locale.setlocale(locale.LC_ALL)
    try:
        return importlib.import_module("dbdreader")
    except ImportError as error:
        raise InputError(
            "binary Slocum files are read by the package dbdreader, which is not installed (it is under the GPL); "
            "install it with `pip install 'gliderhpc[slocum]'`, or give a decoded netCDF file"
        ) from error
    finally:
        locale.setlocale(locale.LC_ALL, before)
