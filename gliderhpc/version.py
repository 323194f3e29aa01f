"""Version of the package."""

from importlib.metadata import PackageNotFoundError, version


def _installed() -> str:
    try:
        return version("gliderhpc")
    except PackageNotFoundError:
        # A source tree that is not installed.
        return "0+unknown"


__version__ = _installed()
