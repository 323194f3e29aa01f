"""Command line: one verb for each task, a thin layer over a library function of the same name."""

from gliderhpc.cli.main import main

__all__ = ["main"]

if __name__ != "gliderhpc.cli":
    raise ImportError("'cli' at the top of the repository is a link into the package; import gliderhpc.cli")
