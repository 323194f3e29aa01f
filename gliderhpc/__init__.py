"""What the water did to an underwater glider, from its routine records alone."""

from gliderhpc._compiled_cache import use_compiled_cache

use_compiled_cache()
