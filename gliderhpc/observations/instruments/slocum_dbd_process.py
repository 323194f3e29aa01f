"""Script that reads binary records with dbdreader in a separate process, run by `DbdProcess`.

It imports nothing from gliderhpc, which makes it start quickly. A line of JSON on the standard input requests one file,
and a line on the standard output is the answer. The values are written to the file named in the request.
"""

import contextlib
import importlib
import json
import os
import sys
from typing import Any

import numpy as np

MAX_MEMORY = 4 << 30
"""Limit of the address space (bytes); a damaged header can lead to a request for any amount of memory."""


def answer(request: dict[str, Any], library: Any) -> dict[str, Any]:
    """Read one file.

    Parameters
    ----------
    request : dict
        ``path`` of the file, ``cache`` folder, ``names`` of the wanted sensors, and path of the file for the
        ``values``.
    library : module
        The module dbdreader.
    """
    opened = library.DBD(request["path"], cacheDir=request["cache"])
    held = [name for name in request["names"] if name in opened.parameterNames]
    read = opened.get(*held, return_nans=True, decimalLatLon=False, discardBadLatLon=False) if held else []
    series = [read] if len(held) == 1 else read
    columns = [np.asarray(column[1], dtype=np.float64) for column in series]
    np.save(request["values"], np.array(columns, dtype=np.float64).reshape(len(held), -1), allow_pickle=False)
    return {"held": held, "units": [str(opened.parameterUnits[name]) for name in held]}


def main() -> None:
    """Answer requests until there are no more."""
    # Output that the library prints must not mix with the answers.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource  # Windows has none.

        resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY, MAX_MEMORY))
    dbdreader = importlib.import_module("dbdreader")
    for line in sys.stdin:
        try:
            reply = answer(json.loads(line), dbdreader)
        except Exception as error:  # noqa: BLE001 - whatever the library raises is the answer
            reply = {"error": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(reply) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
