"""Twin studies at their smallest size, run with the program."""

import json

import numpy as np
import pytest
from support.missions import program

from benchmarks import twins as twins_page
from benchmarks.sections import section_of
from gliderhpc.estimation.current_errors import read_budget
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.mission.executors import SerialExecutor
from gliderhpc.platform import read_platform
from gliderhpc.twins.cases import QUIET, RecordChanges, TwinCase, noiseless, with_impulses, world
from gliderhpc.twins.estimators.methods import ESTIMATORS
from gliderhpc.twins.inversion import invert_twin
from gliderhpc.twins.scoring import find_impulses, score
from gliderhpc.twins.study import labelled, run_all, scored_row

pytestmark = pytest.mark.compiled

HULL = read_platform("petrel-l")
SETTINGS = EstimationSettings()


def _case(**changes):
    return TwinCase(**({"hull": HULL, "scenario": world(40.0), "seed": 5, "settings": SETTINGS} | changes))


@pytest.fixture(scope="module")
def usual():
    return score(invert_twin(_case()))


def _timeless(row):
    return {name: value for name, value in row.items() if name != "seconds"}


def test_scores_depend_only_on_the_seed(usual):
    again = score(invert_twin(_case()))
    assert _timeless(again) == _timeless(usual)
    other = score(invert_twin(_case(seed=6)))
    assert other["rmse_B_cr"] != usual["rmse_B_cr"]


def test_rows_come_in_the_order_of_the_runs():
    class Backwards(SerialExecutor):
        def run(self, function, jobs):
            return (function(job) for job in reversed(jobs))

    assert run_all([1, 2, 3], Backwards(), lambda: None, function=float) == [1.0, 2.0, 3.0]


def test_truth_and_estimate_lie_on_the_same_steps(usual):
    inversion = invert_twin(_case())
    n = len(inversion.estimate.solution.disturbances)
    assert inversion.truth.shape == (n, 6)
    assert inversion.states.shape == (n + 1, 12)
    depth = inversion.estimate.series.measurements[:, 3]
    assert np.abs(depth - inversion.states[:, 5]).max() < 0.2
    assert 0.5 < inversion.steady.mean() < 1.0
    assert usual["correlation_B_cr"] > 0.95
    assert usual["rmse_B_cr"] < 0.15


def test_truth_averages_over_other_steps():
    coarse = invert_twin(_case(settings=EstimationSettings(step=0.2)))
    fine = invert_twin(_case())
    count = len(coarse.truth) - 1
    np.testing.assert_allclose(
        coarse.truth[:count], fine.truth[: 2 * count].reshape(count, 2, 6).mean(axis=1), atol=1e-9
    )


def test_perfect_sensors_and_no_disturbance_leave_next_to_nothing_in_yaw():
    quiet = world(40.0, disturbances=QUIET)
    clean = score(invert_twin(_case(scenario=noiseless(quiet))))
    noisy = score(invert_twin(_case(scenario=quiet)))
    assert clean["rmse_B_cr"] < noisy["rmse_B_cr"] < 0.1
    assert clean["truth_B_cr"] == 0.0


def test_a_pitch_offset_goes_into_the_pitch_moment_and_a_heading_offset_nowhere(usual):
    pitch = score(invert_twin(_case(changes=RecordChanges(pitch_offset=1.0))))
    heading = score(invert_twin(_case(changes=RecordChanges(heading_offset=1.0))))
    assert pitch["bias_climb_B_cq"] - usual["bias_climb_B_cq"] == pytest.approx(0.34, rel=0.15)
    for channel in ("B_cu", "B_cq", "B_cr"):
        assert abs(heading[f"bias_dive_{channel}"] - usual[f"bias_dive_{channel}"]) <= 0.01


def test_an_error_of_the_first_guess_decays(usual):
    wrong = score(invert_twin(_case(initial_error=(0.0,) * 6 + (0.1,) + (0.0,) * 5)))
    assert wrong["rmse_B_cr"] != usual["rmse_B_cr"]
    assert wrong["rmse_B_cr"] == pytest.approx(usual["rmse_B_cr"], rel=0.2)


def test_impulses_are_found_where_they_are():
    scenario = with_impulses(world(60.0), 1.5, 2.0, 60.0)
    findings = find_impulses(invert_twin(_case(scenario=scenario)))
    assert len(findings) >= 3
    for finding in findings:
        assert abs(finding.amplitude) == 1.5
        assert finding.gain == pytest.approx(0.9, abs=0.25)
        assert abs(finding.delay) < 0.6


def test_a_refused_record_gives_a_row_with_the_reason():
    case = _case(changes=RecordChanges(dropout=1.0))
    row = scored_row(labelled(case, sweep="dropout"))
    assert row["sweep"] == "dropout"
    assert "never measured together" in row["refused"]


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """Folder that the studies write into."""
    return tmp_path_factory.mktemp("twins")


def _run(study, out, *more):
    result = program("twin", study, "--out", out, "--quick", "--workers", 0, *more)
    assert result.status == 0, result.err
    assert "paper" in result.out
    assert "ratio" in result.out
    return json.loads((out / f"{study}.json").read_text("utf-8")), result


@pytest.fixture(scope="module")
def windows(out):
    return _run("windows", out, "--platform", "petrel-l", "--seeds", 1)


@pytest.fixture(scope="module")
def sensitivity(out):
    return _run("sensitivity", out, "--seeds", 1)


@pytest.fixture(scope="module")
def recoverability(out):
    return _run("recoverability", out, "--seeds", 3)


@pytest.fixture(scope="module")
def estimators(out):
    return _run("estimators", out, "--seeds", 1)


@pytest.mark.long
@pytest.mark.parametrize("study", ["windows", "sensitivity", "recoverability", "estimators"])
def test_every_study_leaves_its_files(study, out, request):
    content, _ = request.getfixturevalue(study)
    assert content["quick"] is True
    assert (out / f"{study}.csv").stat().st_size > 1000
    assert (out / f"{study}.png").read_bytes().startswith(b"\x89PNG")


def test_windows(windows):
    content, result = windows
    assert [line["preset"] for line in content["verdicts"]] == ["recommended", "paper"]
    assert "petrel-l, recommended: 30 s is" in result.out
    lines = {(line["preset"], line["sweep"], line["value"]): line for line in content["summary"]}
    slid, unslid = (lines["recommended", sweep, 30.0] for sweep in ("sliding", "not sliding"))
    assert slid["rmse_B_cr"] < unslid["rmse_B_cr"]
    assert slid["jump_ratio"] < unslid["jump_ratio"]
    assert slid["retracted"] > 0.5
    assert unslid["retracted"] == 0.0


def test_sensitivity(sensitivity):
    content, _ = sensitivity
    pitch = next(
        line
        for line in content["biases"]
        if line["value"] == "pitch" and line["phase"] == "climb" and line["preset"] == "recommended"
    )
    assert pitch["B_cq"] == pytest.approx(0.34, rel=0.15)
    assert all(line["refused"] == 0 for line in content["summary"])


def test_recoverability(recoverability, out):
    content, _ = recoverability
    budget = read_budget(out / "budget.yaml")
    assert budget.platform == "petrel-l"
    assert budget.detection_floor > budget.identification_noise
    assert budget.how["axial_error"]
    assert content["budget"]["axial_error"] == pytest.approx(budget.axial_error, rel=1e-3)


def test_estimators(estimators, out):
    content, result = estimators
    lines = {(line["kind"], line["arm"]): line for line in content["summary"]}
    kinds = {kind for kind, _ in lines}
    assert kinds == {
        "calm", "impulsive", "harsh", "calm, 4 s", "calm, 20 s", "coefficients within 15%", "drawn from the prior",
    }  # fmt: skip
    assert all((kind, estimator.name) in lines for kind in kinds for estimator in ESTIMATORS)
    impulsive = {estimator.name: lines["impulsive", estimator.name] for estimator in ESTIMATORS}
    assert impulsive["smoother"]["rmse_B_cr"] < 0.5 * impulsive["paper"]["rmse_B_cr"]
    assert impulsive["smoother"]["rmse_B_cr"] < impulsive["filter"]["rmse_B_cr"]
    assert impulsive["adjoint_smoothed"]["rmse_B_cr"] < impulsive["adjoint"]["rmse_B_cr"]
    assert impulsive["smoother"]["impulses"] >= 1
    assert 0.0 <= impulsive["smoother"]["coverage_68_inside"] <= impulsive["smoother"]["coverage_95_inside"] <= 1.0
    assert impulsive["filter"]["width_B_cr"] is None
    assert impulsive["filter"]["rounds"] is None
    wrong = lines["coefficients within 15%", "smoother"]
    assert wrong["offset_B_cu"] > impulsive["smoother"]["offset_B_cu"]
    assert "For the yaw moment where there are impulses: " in result.out
    assert (out / "estimators.md").read_text("utf-8").startswith("# Choosing an estimator")


def test_twin_pages_have_a_section_for_every_study(windows, sensitivity, recoverability, estimators, out, tmp_path):
    readme = tmp_path / "README.md"
    readme.write_text("before\n<!-- estimators -->\nold\n<!-- /estimators -->\nafter\n", "utf-8")
    twins_page.main(out, tmp_path, readme)
    page = (tmp_path / "twins.md").read_text("utf-8")
    for title in ("## Windows", "## Sensitivity", "## Recoverability", "### The budget"):
        assert title in page
    assert "| yaw RMSE, 30 s overlapping | N m | 0.150 |" in page
    assert "every setting (medians)" not in page
    assert "RMSE of the yaw moment" in page
    tables = (tmp_path / "twins-tables.md").read_text("utf-8")
    for title in ("## Windows", ": every setting (medians)", "### Offsets, recommended", "detection rate"):
        assert title in tables
    assert (tmp_path / "twins" / "windows.png").exists()
    page = (tmp_path / "estimators.md").read_text("utf-8")
    assert "](twins/estimators.png)" in page
    assert (tmp_path / "twins" / "estimators.png").exists()
    section = section_of(readme.read_text("utf-8"), "estimators")
    assert section in page
    assert section.count("| smoother |") == 1
    assert "figures that are asked" not in page
    assert "figures that are asked" not in section


def test_twin_pages_without_any_study_are_refused(tmp_path):
    with pytest.raises(SystemExit, match="gliderhpc twin STUDY"):
        twins_page.main(tmp_path, tmp_path, tmp_path / "README.md")


def test_the_readme_claims_what_the_page_of_the_estimators_says():
    section = section_of((twins_page.ROOT / "README.md").read_text("utf-8"), "estimators")
    assert "gliderhpc twin estimators" in section
    assert section in (twins_page.ROOT / "docs" / "estimators.md").read_text("utf-8")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("windows", "--seeds", 0), "0 is not in the range 1<=x"),
        (("recoverability", "--seeds", 1), "at least 3"),
        (("sensitivity", "--platform", "petrol"), "unknown platform"),
    ],
)
def test_a_study_that_cannot_run_is_refused_in_one_line(tmp_path, arguments, message):
    result = program("twin", arguments[0], "--out", tmp_path, "--quick", *arguments[1:])
    assert result.status == 2
    assert message in result.err
    assert "Traceback" not in result.err
