"""Single profile: its smoother runs in a second thread while its windows are solved."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from support.missions import archive_bytes, profile_series, program

from gliderhpc.estimation import profile as estimation
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.profile import estimate_profiles
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.glider import Glider
from gliderhpc.mission import jobs
from gliderhpc.mission.executors import DaskExecutor, LocalExecutor, SerialExecutor, spare_threads
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations
from gliderhpc.platform import read_platform

pytestmark = pytest.mark.compiled


def arrays(estimate):
    """Return the arrays of an estimate by name."""
    parts = {
        "filter": estimate.filtered.states,
        "windows": estimate.solution.disturbances,
        "path": estimate.solution.states,
    }
    parts |= {name: value for name, value in vars(estimate.smoothed).items() if isinstance(value, np.ndarray)}
    hull = estimate.hull
    parts |= {
        "score": hull.information.score,
        "information": hull.information.information,
        "hull": hull.errors.covariance,
        "share": hull.share,
        "medians": hull.glide.medians,
    }
    return parts


@pytest.mark.parametrize("start", ["prior", "smoothed"])
def test_estimates_with_and_without_a_second_thread_are_identical(brief, start):
    settings = EstimationSettings(start=start)
    profile = prepare_profile(Glider(read_platform("petrel-l")), profile_series(brief, 1, settings))
    ((_, alone),) = estimate_profiles([(1, profile)], settings, with_hull=True)
    with ThreadPoolExecutor(1) as threads:
        ((_, beside),) = estimate_profiles([(1, profile)], settings, with_hull=True, threads=threads)
    assert alone.solution.windows == beside.solution.windows
    found, expected = arrays(beside), arrays(alone)
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)


def test_an_error_in_the_second_thread_is_raised(brief, monkeypatch):
    def fail(*_, **__):
        raise RuntimeError("no estimate")

    settings = EstimationSettings()
    profile = prepare_profile(Glider(read_platform("petrel-l")), profile_series(brief, 1, settings))
    monkeypatch.setattr(estimation, "smooth_profile", fail)
    with ThreadPoolExecutor(1) as threads, pytest.raises(RuntimeError, match="no estimate"):
        list(estimate_profiles([(1, profile)], settings, with_hull=True, threads=threads))


def test_only_a_profile_alone_on_two_cores_has_a_second_thread(brief, tmp_path, monkeypatch):
    """The archives are the same."""
    given = []

    def estimates(*arguments, threads, **named):
        given.append(threads is not None)
        return estimate_profiles(*arguments, threads=threads, **named)

    monkeypatch.setattr(jobs, "estimate_profiles", estimates)
    for cores, profiles in ((1, "2"), (2, "2"), (2, "1,2")):
        monkeypatch.setattr("gliderhpc.mission.executors.default_workers", lambda cores=cores: cores)
        answer = program(
            "run-mission", brief, "--platform", "petrel-l", "--workers", 0, "--profiles", profiles,
            "--store", tmp_path / f"{cores}-{len(profiles)}.zarr",
        )  # fmt: skip
        assert answer.status == 0, answer.err
    assert given == [False, True, False]
    assert archive_bytes(tmp_path / "1-1.zarr") == archive_bytes(tmp_path / "2-1.zarr")


def test_a_profile_of_which_only_the_fixes_changed_is_not_counted(brief):
    """A dive that lands gives the one before it another fix; the two are one job."""
    with open_observations(brief) as observations:
        work = jobs.RunInputs(observations, read_platform("petrel-l"), MissionSettings(), "mission.zarr", {0: None})
        batches = ([(1, 0)], [(1, 0), (2, 1)], [(2, 1), (3, 2)])
        assert [work.job(tuple(each), None).estimated_count for each in batches] == [0, 1, 2]


def test_jobs_share_the_cores(monkeypatch):
    monkeypatch.setattr("gliderhpc.mission.executors.default_workers", lambda: 8)
    assert [SerialExecutor().threads(jobs) for jobs in (1, 5)] == [8, 8]
    assert [LocalExecutor(4).threads(jobs) for jobs in (0, 1, 2, 3, 4, 9)] == [4, 4, 2, 1, 1, 1]
    assert DaskExecutor.threads(SerialExecutor(), 1) == 1, "a task of a cluster has one core"


def test_without_a_spare_thread_there_is_no_pool():
    with spare_threads(0) as threads:
        assert threads is None
    with spare_threads(1) as threads:
        assert threads.submit(int, "7").result() == 7
