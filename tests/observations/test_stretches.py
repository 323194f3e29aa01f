"""Stretches of a mask: they rebuild it, in order, and never touch."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gliderhpc.observations.profiles import stretches


@given(st.lists(st.booleans(), max_size=40))
def test_stretches_rebuild_the_mask(values):
    mask = np.array(values, dtype=bool)
    found = stretches(mask)
    rebuilt = np.zeros_like(mask)
    for begin, end in found:
        rebuilt[begin:end] = True
    np.testing.assert_array_equal(rebuilt, mask)
    assert all(end < begin for (_, end), (begin, _) in pairwise(found))
