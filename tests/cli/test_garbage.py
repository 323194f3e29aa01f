"""Frequency of garbage collection in a process of the program."""

import gc

import pytest

from gliderhpc.garbage import ALLOCATIONS, infrequent_collection


@pytest.mark.parametrize("before", [700, 10 * ALLOCATIONS])
def test_garbage_is_searched_for_less_often_never_more_often(before):
    found = gc.get_threshold()
    gc.set_threshold(before, 10, 10)
    try:
        with infrequent_collection():
            within = gc.get_threshold()
        after = gc.get_threshold()
    finally:
        gc.set_threshold(*found)
    assert within == (max(before, ALLOCATIONS), 10, 10)
    assert after == (before, 10, 10)
