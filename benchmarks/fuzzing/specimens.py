"""Valid inputs to edit: synthetic records of every instrument, a mission and its archive."""

from __future__ import annotations

import importlib
import shutil
import sys
from pathlib import Path

import numpy as np

from benchmarks.fuzzing import netcdf_edits
from benchmarks.fuzzing.program import Call, Program

_TESTS = str(Path(__file__).resolve().parents[2] / "tests")

HULL = "petrel-l"
SCENARIO = "name: swift\nprofiles: 3\ndepth: 15.0\nsteering: {interval: 120.0}\n"
"""Three profiles of about three minutes."""

BUDGET = """platform: petrel-l
axial_error: 0.01
relative_error: 0.05
heading_error: 3.0
cross_track_error: 0.01
identification_noise: 0.02
detection_floor: 0.1
axial_offset_dive: 0.0
axial_offset_climb: 0.0
axial_offset_rms: 0.01
exact_axial_error: 0.005
"""

NAVIGATION = (
    "Timestamp;NavState;SecurityLevel;Heading;Declination;Pitch;Roll;Depth;Temperature;Pa;Lat;Lon;DesiredH;BallastCmd;"
    "BallastPos;LinCmd;LinPos;AngCmd;AngPos;Voltage;Altitude;"
)
PAYLOAD = "PLD_REALTIMECLOCK;NAV_DEPTH;GPCTD_CONDUCTIVITY;GPCTD_TEMPERATURE;GPCTD_PRESSURE;GPCTD_DOF;"


class Specimens:
    """Valid inputs below one folder; those that the program itself has to make are made on first use."""

    def __init__(self, folder: Path, program: Program) -> None:
        self.folder, self._program = folder, program
        folder.mkdir(parents=True, exist_ok=True)

    def seaexplorer(self) -> Path:
        """Folder of two cycles of navigation and payload, and the last surfacing."""
        return self._made("seaexplorer", write_seaexplorer)

    def slocum(self) -> Path:
        """Folder of a pair of binary files of one segment."""
        return self._made("slocum", _write_slocum)

    def slocum_netcdf(self) -> Path:
        """File of native sensors."""
        return self._made("slocum-netcdf", _write_slocum_netcdf) / "segment.nc"

    def seaglider(self) -> Path:
        """Folder of three dives."""
        return self._made("seaglider", _write_seaglider)

    def og1(self) -> Path:
        """OG1 file of two dives."""
        return self._made("og1", _write_og1) / "glider.nc"

    def observations(self) -> Path:
        """Observation file of three short profiles; its truth lies next to it."""
        return self._made("mission", self._simulate) / "swift.nc"

    def shorter(self) -> Path:
        """Observation file of the first two profiles."""
        return self._made("shorter", self._shorten) / "swift.nc"

    def archive(self) -> Path:
        """Archive of the three profiles, with a study in it."""
        return self._made("archive", self._estimate) / "swift.zarr"

    def short_archive(self) -> Path:
        """Archive of the first two profiles."""
        return self._made("short-archive", self._estimate_shorter) / "swift.zarr"

    def platform(self) -> Path:
        """Platform file."""
        return self._made("platform", self._print_platform) / "hull.yaml"

    def _made(self, name: str, make) -> Path:
        folder = self.folder / name
        if not folder.is_dir():
            unfinished = self.folder / f"{name}.unfinished"
            shutil.rmtree(unfinished, ignore_errors=True)
            unfinished.mkdir()
            make(unfinished)
            unfinished.rename(folder)
        return folder

    def _run(self, folder: Path, *arguments: object) -> str:
        limit, self._program.limit = self._program.limit, 900.0
        ended = self._program.run(Call(tuple(map(str, arguments)), folder))
        self._program.limit = limit
        if ended.status:
            raise RuntimeError(f"{' '.join(map(str, arguments))}: status {ended.status}\n{ended.text}")
        return ended.text

    def _simulate(self, folder: Path) -> None:
        (folder / "swift.yaml").write_text(SCENARIO, "utf-8")
        self._run(folder, "simulate-mission", "swift.nc", "--platform", HULL, "--scenario", "swift.yaml", "--seed", 3)

    def _shorten(self, folder: Path) -> None:
        shutil.copy(self.observations(), folder / "swift.nc")
        file = netcdf_edits.read(folder / "swift.nc")
        rows = file.variables["profile"].values < 3
        last = file.variables["time"].values[~rows][0]
        for name, keep in (("time", rows), ("fix", file.variables["fix_time"].values < last)):
            for variable in file.variables.values():
                if variable.dimensions == (name,):
                    variable.values = variable.values[keep]
            file.sizes[name] = int(keep.sum())
        netcdf_edits.write(file, folder / "swift.nc")

    def _estimate(self, folder: Path) -> None:
        observations = self.observations()
        self._run(folder, *run_mission(observations, "swift.zarr"))
        self._run(folder, "analyze", "swift.zarr", "currents", "--workers", 0, "--out", "study")

    def _estimate_shorter(self, folder: Path) -> None:
        self._run(folder, *run_mission(self.shorter(), "swift.zarr"))

    def _print_platform(self, folder: Path) -> None:
        (folder / "hull.yaml").write_text(self._run(folder, "platforms", HULL, "--yaml"), "utf-8")


def run_mission(observations: object, store: object, *more: object) -> tuple[object, ...]:
    """Arguments of the main job, in one process."""
    return ("run-mission", observations, "--platform", HULL, "--store", store, "--workers", 0, *more)


def _stamp(time: np.datetime64) -> str:
    date, clock = str(time.astype("datetime64[s]")).split("T")
    return f"{'/'.join(reversed(date.split('-')))} {clock}"


def write_seaexplorer(folder: Path) -> None:
    """Write cycles 5 and 6 of a mission and what follows them: 20 s a row, afloat, dive and climb of 30 rows."""
    time, step = np.datetime64("2023-07-05T10:00:00"), np.timedelta64(20, "s")
    for cycle in (5, 6, 7):
        half = np.linspace(10.0, 60.0 + cycle, 30)
        rows = [(116, 1.0, -5.0)] * 6 + [(110, 1.0, -10.0), (110, 4.0, -60.0)]
        if cycle < 7:
            rows += [(100, d, -20.0) for d in half] + [(117, d, 20.0) for d in half[::-1]] + [(115, 8.0, -60.0)] * 2
        navigation, payload = [NAVIGATION], [PAYLOAD]
        for index, (state, depth, pitch) in enumerate(rows):
            position = 4830.0 + cycle + 0.001 * min(index, 6)
            navigation.append(
                f"{_stamp(time)};{state};0;350.0;16;{pitch};4.5;{depth:.1f};10.0;70000;{position:.3f};-12330.000;270;"
                f"150;{-250.5 if pitch < 0 else 250.5};73;{73.0 if pitch < 0 else 50.0};-3;-3.6;28.8;-1.0;"
            )
            payload.append(f"{_stamp(time)}.500;{depth:.1f};3.5;10.0;{1.01 * depth:.2f};0;")
            time = time + step
        (folder / f"sea099.3.gli.sub.{cycle}").write_text("\n".join(navigation) + "\n", "utf-8")
        (folder / f"sea099.3.pld1.raw.{cycle}").write_text("\n".join(payload) + "\n", "utf-8")


def _write_slocum(folder: Path) -> None:
    made = _of_tests("slocum_files")
    for segment in (0, 1):
        stem = f"unit-2015-175-0-{segment}"
        made.write_binary(folder / f"{stem}.dbd", made.flight(segment), name=stem)
        made.write_binary(folder / f"{stem}.ebd", made.science(segment), name=stem)


def _write_slocum_netcdf(folder: Path) -> None:
    made = _of_tests("slocum_files")
    segments = [made.flight(0), made.flight(1)], [made.science(0), made.science(1)]
    made.write_netcdf(folder / "segment.nc", *(made.joined(columns) for columns in segments))


def _write_seaglider(folder: Path) -> None:
    for dive in (1, 2, 3):
        _of_tests("seaglider_files").write_dive(folder, dive, columns=dive < 3)


def _write_og1(folder: Path) -> None:
    _of_tests("seaglider_files").write_og1(folder / "glider.nc")


def _of_tests(name: str):
    """Import one of the tests' makers of files, none of which imports the program."""
    if _TESTS not in sys.path:
        sys.path.append(_TESTS)
    return importlib.import_module(f"support.{name}")
