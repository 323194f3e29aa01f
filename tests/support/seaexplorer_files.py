"""A SeaExplorer mission of three cycles, written row by row as the glider does."""

from pathlib import Path

import numpy as np

NAVIGATION = (
    "Timestamp;NavState;SecurityLevel;Heading;Declination;Pitch;Roll;Depth;Temperature;Pa;Lat;Lon;DesiredH;"
    "BallastCmd;BallastPos;LinCmd;LinPos;AngCmd;AngPos;Voltage;Altitude;"
)
PAYLOAD = "PLD_REALTIMECLOCK;NAV_DEPTH;GPCTD_CONDUCTIVITY;GPCTD_TEMPERATURE;GPCTD_PRESSURE;GPCTD_DOF;"
START = np.datetime64("2023-07-05T10:00:00")
SURFACE, DIVE = 10, 60
"""Rows of a surface interval and of a dive; a climb is as long as a dive."""


def stamp(time: np.datetime64) -> str:
    date, clock = str(time.astype("datetime64[s]")).split("T")
    year, month, day = date.split("-")
    return f"{day}/{month}/{year} {clock}"


def row(time, state, depth, pitch=-20.0, latitude=4830.000, longitude=-12330.000, linear=73.0, heading=350.0) -> str:
    return (
        f"{stamp(time)};{state};0;{heading};16;{pitch};4.5;{depth:.1f};10.0;70000;{latitude:.3f};{longitude:.3f};270;"
        f"150;-250.5;73;{linear};-3;-3.6;28.8;-1.0;"
    )


def cycle_rows(time: np.datetime64, position: float, maximum: float, surfaces: bool = True) -> list[str]:
    """Rows of one cycle's file as the glider writes them: the last of the climb before, the surface, dive and climb."""
    rows = [row(time, 117, 9.5, 20.0)]
    step = np.timedelta64(20, "s")
    states = [(115, 8.0, -60.0)] * 3 + [(116, 1.0, -5.0)] * SURFACE + [(110, 1.0, -10.0), (110, 4.0, -60.0)]
    if not surfaces:
        states = [(110, 9.0, -10.0), (110, 9.5, -20.0)]
    states += [(100, depth, -20.0) for depth in np.linspace(10.0, maximum, DIVE)]
    states += [(117, depth, 20.0) for depth in np.linspace(maximum, 10.5, DIVE)]
    moved = 0
    for index, (state, depth, pitch) in enumerate(states, start=1):
        # The first row of the transmitting state still reports the position of the dive's beginning.
        moved += state == 116 and states[index - 2][0] == 116
        rows.append(row(time + index * step, state, depth, pitch, latitude=position + 0.001 * moved))
    return rows


def write_mission(folder: Path, *, surfaces: tuple[bool, ...] = (True, True, True)) -> Path:
    """Cycles 5, 6 and 7 of mission 3, and an eighth file that holds the last surfacing."""
    folder.mkdir(exist_ok=True)
    time = START
    for index, does in enumerate((*surfaces, True)):
        lines = cycle_rows(time, 4830.0 + index, 100.0 + index, does)
        if index == len(surfaces):
            lines = lines[: 4 + SURFACE]
        (folder / f"sea099.3.gli.sub.{5 + index}").write_text("\n".join([NAVIGATION, *lines]) + "\n")
        time = time + np.timedelta64(20 * len(lines), "s")
    return folder


def edit(folder: Path, cycle: int, change) -> None:
    path = folder / f"sea099.3.gli.sub.{cycle}"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(change(lines) or lines) + "\n")


def shift_rows(folder: Path, cycle: int, first: int, hours: int, last: int | None = None) -> None:
    """Shift the times of a file from a row on, up to before another one."""

    def change(lines):
        shifted = []
        for line in lines[first:last]:
            written, rest = line.split(";", 1)
            day, clock = written.split(" ")
            time = np.datetime64("-".join(reversed(day.split("/"))) + "T" + clock)
            shifted.append(f"{stamp(time + np.timedelta64(hours, 'h'))};{rest}")
        return [*lines[:first], *shifted, *([] if last is None else lines[last:])]

    edit(folder, cycle, change)
