"""Lanes engine and reference engine on a synthetic mission: same windows, same outcomes, same estimates."""

import pytest
from support.missions import estimate

from benchmarks import agreement as engines_page
from gliderhpc.archive.mission import open_mission
from gliderhpc.observations.truth import truth_path

pytestmark = pytest.mark.compiled


def agreement(twin, lanes_store, preset):
    store = twin.with_name(f"{preset}-scipy.zarr")
    estimate(twin, store, preset, {"engine": "scipy"})
    with open_mission(lanes_store) as lanes, open_mission(store) as reference:
        assert (lanes.attrs["engine"], reference.attrs["engine"]) == ("lanes", "scipy")
        return engines_page.agreement(lanes, reference, truth_path(twin))


def assert_agree(found, bound):
    assert found.windows > 400
    assert found.same_outcome >= 0.99
    # A median of integers changes by integers; a difference of one is accepted like that of a tenth.
    assert found.iterations[0] == pytest.approx(found.iterations[1], rel=0.1, abs=1.0)
    assert len(found.rmse) == 11
    for name, (lanes, reference) in found.rmse.items():
        assert lanes == pytest.approx(reference, rel=bound), name
        assert lanes > 0.0


@pytest.mark.long
def test_engines_agree_by_the_recommended_preset(twin, recommended):
    """Every disturbance, the tracking and the current agree to three per cent."""
    assert_agree(agreement(twin, recommended, "recommended"), 0.03)


@pytest.mark.long
def test_engines_agree_by_the_papers_preset(twin, paper):
    """Paths that stop early diverge; the engines agree as well as one engine with other rounding (docs/engines.md)."""
    assert_agree(agreement(twin, paper, "paper"), 0.2)


@pytest.mark.long
def test_the_page_shows_the_ratio_of_different_errors(twin, recommended, paper):
    """The two presets have different errors, and the table shows the difference."""
    with open_mission(recommended) as first, open_mission(paper) as second:
        found = engines_page.agreement(first, second, truth_path(twin))
    ours, theirs = found.rmse["B_cu surge force, N"]
    assert theirs > 2.0 * ours
    text = "\n".join(engines_page.section("Presets", found, [found]))
    assert f"| {ours / theirs:.3f} | {ours / theirs:.3f} to {ours / theirs:.3f} |" in text
    assert f"{found.windows} windows" in text
