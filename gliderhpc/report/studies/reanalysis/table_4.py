"""Table 4: speed and direction of every current, and each model's distance from the glider's ellipse."""

from typing import Any

import numpy as np

from gliderhpc.findings.tables import markdown
from gliderhpc.studies.library.current_difference import direction, speed
from gliderhpc.studies.reanalysis.compared import Compared

_DIGITS = {"speed": 3, "direction": 0, "distance": 1, "day": 0}
_ABSENT = "–"


def table_4(compared: Compared, places: list[int]) -> list[dict[str, Any]]:
    """Rows of the table for the profiles at some places: speeds in m/s, directions in degree, distances in sigma."""
    return [_row(compared, place) for place in places]


def table_4_text(rows: list[dict[str, Any]]) -> str:
    """Lay the table out as text, rounded as the paper's."""
    columns = list(rows[0]) if rows else []
    heading = "Depth-averaged currents: speed (m/s), direction they set to (degree), distance of the models (sigma)\n\n"
    cells = [[_cell(name, value) for name, value in row.items()] for row in rows]
    return heading + markdown(columns, cells, columns) + "\n" if rows else "No profile has a current.\n"


def _row(compared: Compared, place: int) -> dict[str, Any]:
    velocities = {
        compared.estimate: compared.glider[place],
        "glide angle": compared.glide_angle[place],
        **dict(zip(compared.names, compared.models[place], strict=True)),
    }
    row: dict[str, Any] = {"profile": int(compared.numbers[place]), "day": float(compared.days[place])}
    for name, velocity in velocities.items():
        row |= {f"{name} speed": float(speed(velocity)), f"{name} direction": float(direction(velocity))}
    distances = zip(compared.names, compared.distance[place], strict=True)
    return row | {f"{name} distance": float(value) for name, value in distances}


def _cell(name: str, value: float) -> str:
    if not np.isfinite(value):
        return _ABSENT
    return f"{value:.{_DIGITS.get(name.rpartition(' ')[2], 0)}f}"
