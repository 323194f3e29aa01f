"""Reads binary records with dbdreader in a process of its own: run as a script by `DbdProcess`.

It imports nothing of gliderhpc, so that it starts quickly. A line of JSON on the standard input asks for one file, a
line on the standard output answers; the values lie in the file that the request names.
"""

import contextlib
import importlib
import json
import os
import resource
import sys
from typing import Any

import numpy as np

MAX_MEMORY = 4 << 30
"""Bytes of address space: a damaged header can ask for any number."""


def answer(request: dict[str, Any], library: Any) -> dict[str, Any]:
    """Read one file.

    Parameters
    ----------
    request : dict
        ``path`` of the file, ``cache`` folder, ``names`` of the sensors wanted, and ``values``, where to write them.
    library : module
        dbdreader.
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
    # What the library prints must not come between the answers.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    with contextlib.suppress(ValueError, OSError):
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
