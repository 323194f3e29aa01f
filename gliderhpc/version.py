"""The package's version, in one place."""

from importlib.metadata import PackageNotFoundError, version


def _installed() -> str:
    try:
        return version("gliderhpc")
    except PackageNotFoundError:
        # Run from a source tree that was never installed.
        return "0+unknown"


__version__ = _installed()
