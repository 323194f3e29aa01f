"""Watch: one new dive is inverted in the watch's own process, several on all cores."""

import subprocess
import sys
from contextlib import closing

import pytest

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.studies.archived import platform_of
from gliderhpc.watch.inversion import WatchWorkers, count_waiting

pytestmark = pytest.mark.compiled


@pytest.mark.parametrize(("wanted", "numbers"), [(None, (0, None)), (0, (0, 0)), (3, (3, 3))])
def test_several_dives_use_all_cores_unless_a_number_is_given(wanted, numbers):
    with closing(WatchWorkers(wanted, "lanes")) as workers:
        assert (workers.number_for(1), workers.number_for(2)) == numbers


def test_workers_stay_open_until_another_number_is_needed():
    with closing(WatchWorkers(None, "lanes")) as workers:
        first = workers.open(0)
        assert workers.open(0) is first
        assert workers.open(2) is not first


def test_dives_waiting_are_the_new_ones_or_all_with_another_hull(brief_store):
    with open_for_reading(brief_store) as archive:
        hull, settings = platform_of(archive), MissionSettings.model_validate(archive.attrs["settings"])
    numbers = [1, 2, 3]
    assert count_waiting(brief_store, numbers, 1, hull, settings) == 1
    assert count_waiting(brief_store, numbers, 1, hull.model_copy(update={"name": "another"}), settings) == 3
    assert count_waiting(brief_store.with_name("none.zarr"), numbers, 1, hull, settings) == 3


def test_a_watch_starts_without_modules_that_take_long_to_import():
    """A watch that cron starts for every dive imports neither figures nor `scipy.stats`, half of its imports."""
    slow = ("matplotlib", "scipy.stats", "distributed")
    code = f"import sys, gliderhpc.watch.watcher; print([name for name in {slow} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout == "[]\n"
