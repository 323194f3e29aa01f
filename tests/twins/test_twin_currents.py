"""``twin currents``: coverage, transfer functions and the passband on plain arrays, and a minimal study."""

import json

import numpy as np
import pytest
from support.missions import program

from benchmarks import twins as twins_page
from gliderhpc.errors import InputError
from gliderhpc.estimation.current_errors import PUBLISHED_TERMS, TERMS, Budget, CurrentErrors, read_budget
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.findings.results import write_findings
from gliderhpc.mission.executors import SerialExecutor
from gliderhpc.platform import read_platform
from gliderhpc.studies.library.passband import PERIODS, describe_bin_averaging, describe_unresolved, passband
from gliderhpc.studies.library.retrieval import DepthResolvedSettings, smooth_stretches, without_baseline
from gliderhpc.twins.cases import TwinCase, paper_dive, world
from gliderhpc.twins.currents.experiment import BUDGET, currents_study
from gliderhpc.twins.currents.resolved import SCALES, LateralSeries, resolved_band, slope, spectral_sums, transfer_lines
from gliderhpc.twins.currents.results import (
    ALL,
    COVERS,
    OVER,
    UNDER,
    EllipseModel,
    coverage_lines,
    ellipse_of,
    error_of,
    fitted_to_cover,
    strongest,
    track_offset,
    without_offset,
)
from gliderhpc.twins.currents.runs import AVERAGED, RESOLVED, CurrentsSize, Spreads, drawn_case, offsets_of
from gliderhpc.twins.inversion import invert_twin, invert_twins
from gliderhpc.twins.study import TwinPlan

HULL = read_platform("petrel-l")
TRUE = CurrentErrors(axial_error=0.02, cross_track_error=0.012, relative_error=0.05, heading_error=4.0)
DEPTH_RATE = 0.14


def _rows(count, settings=TRUE, seed=1, offset=0.0):
    """Twins whose errors are drawn from the covariance of some constants, and an offset along the track."""
    rng = np.random.default_rng(seed)
    rows = []
    for number in range(count):
        truth = rng.uniform(0.0, 0.45) * np.array([np.cos(angle := rng.uniform(0.0, 2.0 * np.pi)), np.sin(angle)])
        track = 2500.0 * np.array([np.cos(course := rng.uniform(0.0, 2.0 * np.pi)), np.sin(course)])
        row = {
            "seed": number, "current_north": truth[0], "current_east": truth[1], "estimate_north": truth[0],
            "estimate_east": truth[1], "track_north": track[0], "track_east": track[1], "bridged": 20.0,
            "duration": 9000.0, "position_variance": 50.0,
        }  # fmt: skip
        error = rng.multivariate_normal(np.zeros(2), ellipse_of(row, settings).covariance) + offset * track / 2500.0
        rows.append(row | {"estimate_north": float(truth[0] + error[0]), "estimate_east": float(truth[1] + error[1])})
    return rows


def _every(settings, rows):
    (line,) = (line for line in coverage_lines(EllipseModel("any", settings, rows)) if line["speed"] == ALL)
    return line


def _times(factor):
    return CurrentErrors(**{name: factor * getattr(TRUE, name) for name in TERMS})


def test_ellipses_of_the_true_constants_cover_and_others_do_not():
    rows = _rows(400, seed=6)
    right = _every(TRUE, rows)
    assert right["verdict"] == COVERS
    assert right["inside_1"] == pytest.approx(0.393, abs=2.0 * right["inside_1_error"])
    assert right["inside_1_error"] == pytest.approx(np.sqrt(0.393 * 0.607 / 400), rel=1e-3)
    wide, narrow = _every(_times(1.6), rows), _every(_times(0.6), rows)
    assert (wide["verdict"], narrow["verdict"]) == (OVER, UNDER)
    assert wide["area"] > right["area"] > narrow["area"]


def test_fitted_constants_cover_twins_they_were_not_fitted_to():
    fitted = fitted_to_cover(_rows(400, seed=2), TERMS)
    assert fitted.axial_error == pytest.approx(TRUE.axial_error, rel=0.3)
    assert _across(fitted) == pytest.approx(_across(TRUE), rel=0.3)
    assert _every(fitted, _rows(400, seed=3))["verdict"] == COVERS


def _across(terms):
    """Error across the track of all terms together, m/s."""
    return np.hypot(np.radians(terms.heading_error) * 2500.0 / 9000.0, terms.cross_track_error)


def test_the_course_s_error_holds_errors_across_the_track_at_any_current():
    """They do not vanish with the current, and neither does the term."""
    compass = CurrentErrors(axial_error=0.01, cross_track_error=0.02, relative_error=0.0, heading_error=0.0)
    rows = _rows(600, compass, seed=4)
    verdicts = {
        names: {
            line["speed"]: line["verdict"]
            for line in coverage_lines(EllipseModel("any", fitted_to_cover(rows, names), _rows(600, compass, seed=5)))
        }
        for names in (PUBLISHED_TERMS, TERMS)
    }
    for names in (PUBLISHED_TERMS, TERMS):
        assert verdicts[names]["0 to 0.1 m/s"] == COVERS
        assert verdicts[names]["over 0.3 m/s"] == COVERS


def test_a_mean_error_along_the_track_is_estimated_and_removed():
    rows = _rows(300, offset=-0.03)
    along, across = track_offset(rows)
    assert along == pytest.approx(-0.03, abs=0.006)
    assert abs(across) < 0.006
    left, _ = track_offset(without_offset(rows, along))
    assert abs(left) < 1e-12
    assert np.linalg.norm(error_of(rows[0])) > 0.0


def _series(retrieved_of_rate, noise=0.0, seed=6):
    """White lateral current on a straight dive at a steady vertical speed, and the response to its rate of change."""
    rng = np.random.default_rng(seed)
    time = np.arange(4000.0)
    periods = np.geomspace(5.0, 150.0, 40)
    phases = rng.uniform(0.0, 2.0 * np.pi, 40)
    angle = 2.0 * np.pi * time[:, None] / periods + phases
    lateral, rate = np.cos(angle).sum(axis=1), (-2.0 * np.pi / periods * np.sin(angle)).sum(axis=1)
    across = np.tile([0.6, 0.8], (len(time), 1))
    return LateralSeries(
        retrieved=retrieved_of_rate * rate + noise * rng.standard_normal(len(time)),
        water=lateral[:, None] * across, across=across, rate=rate, depth_rate=np.full(len(time), DEPTH_RATE),
        interval=1.0,
    )  # fmt: skip


def _lines(series):
    return transfer_lines(
        [{"preset": "any", "world": "any", "factor": 1.0, "spectra": spectral_sums(series).tolist()}]
    )  # fmt: skip


def test_the_transfer_function_of_a_known_one_is_found():
    lines = _lines(_series(2.0))
    middle = [line for line in lines if 1.0 < line["scale"] < 15.0]
    assert len(middle) > 8
    for line in middle:
        assert line["gain_rate"] == pytest.approx(2.0, rel=0.06)
        assert line["gain_current"] == pytest.approx(2.0 * 2.0 * np.pi * DEPTH_RATE / line["scale"], rel=0.15)
        assert abs(line["phase"]) < 2.0
        assert line["coherence"] > 0.9


def test_noise_reduces_coherence_but_not_gain():
    clean, noisy = _lines(_series(2.0)), _lines(_series(2.0, noise=8.0))
    assert np.mean([line["coherence"] for line in noisy]) < 0.7 * np.mean([line["coherence"] for line in clean])
    assert np.median([line["gain_rate"] for line in noisy]) == pytest.approx(2.0, rel=0.15)


def test_a_scale_is_the_vertical_speed_times_the_period():
    series = _series(1.0)
    wave = np.cos(2.0 * np.pi * np.arange(4000.0) / 40.0)
    series = LateralSeries(
        wave, wave[:, None] * series.across, series.across, wave, series.depth_rate, series.interval
    )  # fmt: skip
    power = spectral_sums(series)[1]
    low, high = SCALES[np.argmax(power)], SCALES[np.argmax(power) + 1]
    assert low <= DEPTH_RATE * 40.0 < high


def test_the_band_seen_is_where_half_the_gain_is_left():
    lines = [
        {"scale_low": 2.0**k, "scale_high": 2.0 ** (k + 1), "gain_current": gain}
        for k, gain in enumerate((0.3, 0.1, 0.25, 0.4, 0.3, 0.1, 0.3))
    ]
    assert resolved_band(lines) == (4.0, 32.0)
    with pytest.raises(InputError, match="deeper twins"):
        resolved_band([])


def test_a_slope_on_nothing_is_missing():
    assert np.isnan(slope(np.full(10, 1e-17), np.ones(10)))
    assert slope(np.array([1.0, 2.0, np.nan]), np.array([2.0, 4.0, 9.0])) == 2.0


@pytest.fixture(scope="module")
def band():
    return passband(HULL, speed=0.38, vertical_speed=DEPTH_RATE, step=0.1, settings=DepthResolvedSettings())


@pytest.mark.parametrize("period", [12.0, 30.0, 80.0])
def test_the_formulas_of_baseline_and_smoothing_are_what_the_filters_do(band, period):
    time = np.arange(0.0, 1200.0, band.step)
    wave = np.cos(2.0 * np.pi * time / period)
    inner = slice(len(time) // 4, 3 * len(time) // 4)
    settings = band.settings
    flattened = without_baseline(wave, round(settings.baseline / band.step))[inner]
    smooth = smooth_stretches(wave, round(settings.smoothing / band.step), settings.order)[inner]
    for filtered, response in ((flattened, band.baseline_response), (smooth, band.smoothing_response)):
        amplitude = np.ptp(filtered) / 2.0
        assert amplitude == pytest.approx(float(response(np.array([period]))[0]), abs=0.01)


def test_the_slip_is_that_of_the_first_order_equation(band):
    """``(m + M_f2) dv/dt = -m dU/dt - |K_beta| V v`` under a current of one period, integrated by small steps."""
    period, step, speed = 20.0, 0.005, 0.38
    time = np.arange(0.0, 200.0, step)
    rate = 2.0 * np.pi / period * np.cos(2.0 * np.pi * time / period)
    mass, added, side = HULL.mass.total, HULL.added_mass[1], abs(HULL.viscous.K_beta) * speed
    slip = np.zeros(len(time))
    for k in range(len(time) - 1):
        slip[k + 1] = slip[k] - step * (mass * rate[k] + side * slip[k]) / (mass + added)
    settled = slip[len(time) // 2 :]
    assert np.ptp(settled) / 2.0 == pytest.approx(float(band.slip_response(np.array([period]))[0]), rel=0.01)


def test_limits_follow_the_vertical_speed_and_the_settings(band):
    faster = passband(HULL, speed=0.38, vertical_speed=2.0 * DEPTH_RATE, step=0.1, settings=DepthResolvedSettings())
    assert faster.baseline_limit == pytest.approx(2.0 * band.baseline_limit)
    assert faster.band == pytest.approx([2.0 * scale for scale in band.band])
    longer = passband(
        HULL, speed=0.38, vertical_speed=DEPTH_RATE, step=0.1, settings=DepthResolvedSettings(baseline=120.0)
    )
    assert longer.baseline_limit == pytest.approx(2.0 * band.baseline_limit, rel=0.01)
    assert longer.smoothing_limit == band.smoothing_limit
    low, high = band.band
    assert band.smoothing_limit * 0.8 < low < band.following_limit < high < band.baseline_limit
    periods = np.array([band.baseline_limit, band.smoothing_limit]) / DEPTH_RATE
    assert band.baseline_response(periods)[0] == pytest.approx(0.5, abs=0.01)
    assert band.smoothing_response(periods)[1] == pytest.approx(0.5, abs=0.01)
    assert PERIODS[0] < periods.min()
    assert np.sinc(band.settings.bin / band.bin_limit) == pytest.approx(0.5, abs=1e-5)
    assert f"{band.bin_limit:.2g} m" in describe_bin_averaging(band)
    for figure in (f"{band.baseline_limit:.2g} m", f"{band.smoothing_limit:.2g} m", f"{band.following_limit:.2g} m"):
        assert figure in describe_unresolved(band).replace("\n", " ")


def test_draws_are_seeded_independent_and_as_wide_as_they_say():
    spreads, settings, dive = Spreads(), EstimationSettings(), paper_dive(100.0, speed=(0.0, 0.45))
    drawn = [offsets_of(drawn_case(HULL, dive, spreads, settings, seed)) for seed in range(1, 301)]
    assert drawn[4] == offsets_of(drawn_case(HULL, dive, spreads, settings, 5))
    table = {name: np.array([row[name] for row in drawn]) for name in drawn[0]}
    assert table["heading_offset"].std() == pytest.approx(spreads.heading_offset, rel=0.15)
    assert table["neutral_volume_error"].std() == pytest.approx(spreads.neutral_volume, rel=0.15)
    assert abs(np.corrcoef(table["heading_offset"], table["pitch_offset"])[0, 1]) < 0.2
    case = drawn_case(HULL, dive, spreads, settings, 5)
    assert case.assumed == HULL
    assert case.scenario.coefficients.spread == 0.15


@pytest.mark.compiled
def test_twins_inverted_side_by_side_are_those_inverted_alone():
    cases = [TwinCase(HULL, world(30.0), seed, EstimationSettings()) for seed in (1, 2)]
    impossible = TwinCase(HULL, world(30.0, pitch=5.0), 1, EstimationSettings())
    first, refused, second = invert_twins([cases[0], impossible, cases[1]])
    assert isinstance(refused, InputError)
    for case, together in zip(cases, (first, second), strict=True):
        alone = invert_twin(case).estimate.solution.disturbances
        np.testing.assert_allclose(together.estimate.solution.disturbances, alone, atol=1e-6)
    with pytest.raises(InputError):
        invert_twin(impossible)


def _budget(platform="petrel-l"):
    return Budget(
        platform=platform, axial_error=0.01, relative_error=0.03, heading_error=1.0, identification_noise=0.004,
        detection_floor=0.3, axial_offset_dive=0.0, axial_offset_climb=0.0, axial_offset_rms=0.1,
        exact_axial_error=0.002, how={"axial_error": "elsewhere", "identification_noise": "elsewhere"},
    )  # fmt: skip


@pytest.fixture(scope="module")
def findings():
    """The study at its smallest: a dozen drawn twins, and one in each water."""
    study = currents_study(_budget())
    size = CurrentsSize(seeds=12, depth=40.0, water_depth=100.0, water_seeds=1, lagless_seeds=1)
    plan = TwinPlan((HULL,), size, tuple(range(1, 13)), True)
    return study.run(plan, SerialExecutor(), lambda: None)


@pytest.mark.compiled
def test_the_study_writes_coverage_transfer_functions_and_a_budget(findings, tmp_path):
    content = findings.content
    sets = {line["constants"] for line in content["coverage"]}
    assert sets == set(content["constants"])
    assert {"published", "recoverability", "fitted"} <= sets
    twins = {line["constants"]: line["twins"] for line in content["coverage"] if line["speed"] == ALL}
    assert (twins["published"], twins["fitted"]) == (12, 6)
    rows = findings.tables["currents"]
    assert [row["kind"] for row in rows].count(AVERAGED) == 12
    assert [row["kind"] for row in rows].count(RESOLVED) == 14
    median = findings.comparisons["petrel-l, depth-averaged current"][0]
    assert 0.0 < median.ours < 0.05
    assert any(sentence.startswith("The published terms, with 26%") for sentence in content["sentences"])
    low, high = content["seen"]["paper"]
    assert 0.5 <= low < high <= 2.0 * content["formula"]["baseline_limit"]
    strong = [line["coherence"] for line in strongest(content["transfer"], "paper")]
    assert max(strong) > 0.5
    write_findings(findings, "currents", tmp_path)
    budget = read_budget(tmp_path / BUDGET)
    assert budget.current.cross_track_error == pytest.approx(content["constants"]["fitted"]["cross_track_error"], 1e-3)
    assert budget.identification_noise == 0.004
    assert "even seeds" in budget.how["axial_error"]
    assert budget.how["identification_noise"] == "elsewhere"


@pytest.mark.compiled
def test_the_retrieval_follows_strong_fine_shear(findings):
    """Fine shear of a strength that stands out of the noise; dU/dZ changes its sign against it from dive to climb."""
    (strong,) = (
        line
        for line in findings.content["summary"]
        if (line["preset"], line["world"], line["factor"]) == ("paper", "fine shear", 5.0)
    )
    assert strong["correlation_alike"] > 0.4
    assert strong["correlation_shear_dive"] > 0.3
    assert strong["correlation_shear_climb"] < -0.3
    assert strong["lateral_rms"] > 5.0 * findings.content["noise"]["paper"]


@pytest.mark.compiled
def test_the_page_gets_its_section_and_keeps_the_rest(findings, tmp_path):
    write_findings(findings, "currents", tmp_path)
    docs = tmp_path / "docs"
    docs.mkdir()
    page, tables = docs / "twins.md", docs / "twins-tables.md"
    for path in (page, tables):
        path.write_text("before\n<!-- currents -->\nold\n<!-- /currents -->\n", "utf-8")
    twins_page.main(tmp_path, docs, tmp_path / "README.md")
    assert "### Coverage of the ellipses, by speed of the current" in tables.read_text("utf-8")
    text = page.read_text("utf-8")
    assert text.startswith("before\n<!-- currents -->\n## Currents\n")
    assert "old" not in text
    for sentence in json.loads((tmp_path / "currents.json").read_text("utf-8"))["sentences"]:
        assert sentence in text
    assert (docs / "twins" / "currents.png").read_bytes().startswith(b"\x89PNG")
    assert (docs / "twins" / BUDGET).exists()


@pytest.mark.compiled
def test_a_budget_of_another_hull_is_refused():
    with pytest.raises(InputError, match="measured for seawing"):
        currents_study(_budget("seawing")).conclude(TwinPlan((HULL,), None, (1,), True), [])


def test_too_few_twins_are_refused_in_one_line(tmp_path):
    answer = program("twin", "currents", "--out", tmp_path, "--quick", "--seeds", 3)
    assert answer.status == 2
    assert "at least 12" in answer.line
