"""Targets of the estimators, from rows of ``twin estimators`` and figures of ``twin currents``."""

import pytest
from support.estimator_rows import row, rows_of

from benchmarks.twin_targets import Target, current_target, describe_targets, targets
from gliderhpc.twins.estimators.methods import ESTIMATORS
from gliderhpc.twins.estimators.runs import summarise
from gliderhpc.twins.scoring import INTERVALS
from gliderhpc.vocabulary import CHANNELS


def test_targets_are_met_or_not():
    found = rows_of({"smoother": [1.0] * 4, "paper": [1.9] * 4, "adjoint": [2.0] * 4})
    by_name = {target.quantity: target for target in targets(found, summarise(found)) if target.kind == "impulsive"}
    missed, met = (
        by_name["B_cr RMSE over that of adjoint, preset paper"],
        by_name["B_cr RMSE over that of adjoint from prior"],
    )
    assert missed.value == pytest.approx(1.0 / 1.9)
    assert not missed.met
    assert "met in 0 of 4 twins" in missed.remark
    assert met.met
    assert "met in 4 of 4 twins" in met.remark
    line = describe_targets(list(by_name.values()))
    assert "of 9 on the twins *impulsive*" in line


def test_a_channel_without_truth_is_marked():
    found = [row(estimator.name, 1, truth_B_cr=0.0) for estimator in ESTIMATORS]
    names = [target.quantity for target in targets(found, summarise(found))]
    assert "B_cr RMSE over that of adjoint from prior (truth zero)" in names


def test_only_channels_with_signal_have_a_coverage_target():
    widths = {f"width_{name}": 2.0 for name in CHANNELS} | {"width_B_cr": 0.5}
    shares = {f"coverage_{label}_{name}": 0.7 for name in CHANNELS for label in INTERVALS}
    found = [row("smoother", 1, kind="drawn from the prior", **widths, **shares)]
    coverages = {
        target.quantity: target for target in targets(found, summarise(found)) if "coverage" in target.quantity
    }
    assert [name.split()[0] for name in coverages] == ["B_cr", "B_cr"]
    assert coverages["B_cr coverage of 68 % intervals"].met
    assert not coverages["B_cr coverage of 95 % intervals"].met


def test_a_missing_value_does_not_meet_its_target():
    assert not Target("calm", "x", float("nan"), 0.0, 1.0, "").met


def test_the_median_error_of_the_current_has_a_target():
    rows = [{"quantity": "error of the depth-averaged current, median", "ours": 0.016, "remark": "400 twins"}]
    found = current_target({"petrel-l, depth-averaged current": rows})
    assert found.met
    assert not current_target({"any": [rows[0] | {"ours": 0.031}]}).met
