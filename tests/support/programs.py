"""Programs in a separate process."""

import os
import subprocess
import sys


def python(code: str, *arguments: object, **environment: object) -> subprocess.CompletedProcess[str]:
    """Run a program in a separate process that must succeed; a variable of None is removed."""
    given = {**os.environ, **environment}
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        env={name: str(value) for name, value in given.items() if value is not None},
        check=True,
        capture_output=True,
        text=True,
    )
