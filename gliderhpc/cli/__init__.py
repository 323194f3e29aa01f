"""The command line: one verb a job, each a thin shim over a library function of the same name."""

from gliderhpc.cli.main import main

__all__ = ["main"]
