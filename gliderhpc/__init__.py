"""What the water did to an underwater glider, from its routine records alone.

Examples
--------
>>> import gliderhpc
>>> platform = gliderhpc.load_platform("petrel-l")
>>> glider = gliderhpc.Glider(platform)
>>> glider.input_diagonal().shape
(6,)
"""

import importlib
from typing import TYPE_CHECKING, Any

from gliderhpc._compiled_cache import use_compiled_cache
from gliderhpc.version import __version__

if TYPE_CHECKING:
    from gliderhpc.archive.opening import open_mission
    from gliderhpc.flight.glider import Glider
    from gliderhpc.flight.loading import load_platform

__all__ = ["Glider", "__version__", "load_platform", "open_mission"]

_MODULES = {
    "Glider": "gliderhpc.flight.glider",
    "load_platform": "gliderhpc.flight.loading",
    "open_mission": "gliderhpc.archive.opening",
}
"""Each name's module, imported when the name is first used: a command loads only the libraries that it needs."""

# Before numba is imported, which reads its settings once.
use_compiled_cache()


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
