"""What the water did to an underwater glider, from its routine records alone.

Examples
--------
>>> import gliderhpc
>>> platform = gliderhpc.load_platform("petrel-l")
>>> glider = gliderhpc.Glider(platform)
>>> glider.input_diagonal().shape
(6,)
"""

from gliderhpc._compiled_cache import use_compiled_cache

use_compiled_cache()

# Numba must find the cache folder set, so nothing that imports it may come before this line.
from gliderhpc.flight.glider import Glider  # noqa: E402
from gliderhpc.flight.loading import load_platform  # noqa: E402
from gliderhpc.mission.archive import open_mission  # noqa: E402
from gliderhpc.version import __version__  # noqa: E402

__all__ = ["Glider", "__version__", "load_platform", "open_mission"]
