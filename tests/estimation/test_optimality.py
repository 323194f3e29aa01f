"""*Converged* means only that the preset's optimality measure is met (docs/theory/estimate.md).

The measure ``max |s g|``, ``g = (1/h) dJ/db``, is recomputed here from stored values: the archive's disturbances, its
states at the windows' starts, its platform and settings, and the observation file. Windows that start from the smoothed
path are joined; the stored values are then not the solution of a single window, and are tested separately.
"""

from dataclasses import dataclass

import numpy as np
import pytest
import xarray as xr
from support.missions import CHANNELS, estimate, profile_series, program

from gliderhpc.estimation.preparation import controls_of
from gliderhpc.estimation.priors import candidate_priors, default_prior
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.platform import Platform
from gliderhpc.store_schema import OUTCOME

pytestmark = pytest.mark.compiled

TOLERANCE = {"recommended": 5e-4, "paper": 1e-3}
STATES = ("roll", "pitch", "heading", "X", "Y", "depth", "u", "v", "w", "p", "q", "r")
DEGREES = ("roll", "pitch", "heading", "p", "q", "r")
ROUNDING = 0.02
"""Change of the measure by single precision of states and disturbances on disk, relative to the tolerance."""


@dataclass(frozen=True)
class Recomputed:
    """Stored outcome and measures of a window, and the recomputed ones."""

    outcome: str
    stored: float
    measure: float
    stored_cost: float
    cost: float


class Archive:
    """Archive of a mission with its observations, profile by profile."""

    def __init__(self, store, observations):
        self.tree = xr.open_datatree(store, engine="zarr", chunks=None)
        self.observations = observations
        self.platform = Platform.model_validate(self.tree.attrs["platform"])
        self.settings = MissionSettings.model_validate(self.tree.attrs["settings"])
        self.tolerance = TOLERANCE[self.settings.preset]
        self.names = {number: name for name, number in OUTCOME.meanings.items()}

    def scale(self, number):
        """Return the transform's scale s of a profile, for sensors of 1 Hz and the default window."""
        if self.settings.preset == "paper":
            return np.ones(6)
        stored = self.tree.to_dataset()["disturbance_prior"]
        names = dict(zip(stored.attrs["flag_values"], stored.attrs["flag_meanings"].split(), strict=True))
        prior = candidate_priors(self.platform)[names[int(stored.sel(profile=number))]]
        share = np.minimum(1.0, 2.0 * 30.0 / np.array(prior.correlation_time))
        return np.array(prior.deviation) * np.sqrt(share)

    def windows(self, number):
        """Return the stored windows of a profile whose own solution is used from end to end."""
        windows = self.tree["windows"].ds.sel(profile=number)
        count = int(self.tree.to_dataset()["window_count"].sel(profile=number))
        assert np.isnan(windows["start"].values[count:]).all()
        return windows.isel(window=slice(count))

    def recompute(self, number, windows):
        """Recompute the measures of some of a profile's windows."""
        series = profile_series(self.observations, number, self.settings)
        controls = controls_of(self.platform, series)
        stored = self.tree["series"].ds.sel(profile=number)
        disturbances = np.column_stack([stored[name].values for name in CHANNELS])
        states = self._states(number)
        glider, step, scale = Glider(self.platform), series.step, self.scale(number)
        every = round(self.settings.output_interval / step)
        for window in range(windows.sizes["window"]):
            one = windows.isel(window=window)
            begin, end = int(one["start"]), int(one["stop"])
            assert begin % every == 0, "a window starts at a stored record"
            cost, gradient = glider.tracking_cost(
                states[begin // every], controls[begin:end], disturbances[begin:end],
                series.measurements[begin : end + 1], step, weights=series.weights[begin : end + 1],
            )  # fmt: skip
            yield Recomputed(
                self.names[int(one["outcome"])],
                float(one["gradient_norm"]),
                float(np.max(np.abs(scale * gradient)) / step),
                float(one["cost"]),
                cost,
            )

    def _states(self, number):
        stored = self.tree["state"].ds.sel(profile=number)
        columns = [stored[name].values.astype(float) for name in STATES]
        return np.column_stack(
            [np.radians(values) if name in DEGREES else values for name, values in zip(STATES, columns, strict=True)]
        )


def assert_agreement(found, tolerance):
    assert found.measure == pytest.approx(found.stored, abs=ROUNDING * tolerance, rel=ROUNDING)
    assert found.cost == pytest.approx(found.stored_cost, rel=1e-3, abs=1e-6)
    assert (found.outcome == "converged") == (found.measure <= tolerance * (1.0 + ROUNDING))


@pytest.mark.parametrize("preset", ["recommended", "paper"])
def test_stored_optimality_of_windows_without_margin_is_reproduced(brief, tmp_path, preset):
    """Without a margin nothing is overwritten, and every window's measure can be recomputed."""
    store = tmp_path / "whole.zarr"
    estimate(brief, store, preset, {"window.margin": "0", "start": "prior"})
    archive = Archive(store, brief)
    checked = 0
    for number in (1, 2, 3):
        windows = archive.windows(number)
        assert not windows["retracted"].any()
        np.testing.assert_array_equal(windows["start"].values[1:], windows["stop"].values[:-1])
        for found in archive.recompute(number, windows):
            assert_agreement(found, archive.tolerance)
            checked += found.outcome == "converged"
    assert checked > 40


def test_windows_in_rough_water_are_measured_by_the_prior_that_the_archive_names(rough, tmp_path):
    store = tmp_path / "rough.zarr"
    estimate(rough, store, "recommended", {"start": "prior"})
    archive = Archive(store, rough)
    usual = np.array(default_prior(archive.platform).deviation)
    assert archive.scale(1)[1] > 2.0 * usual[1], "sway has a gust prior"
    windows = archive.windows(1)
    whole = windows.isel(window=np.flatnonzero(windows["retracted"].values == 0))
    found = list(archive.recompute(1, whole))
    assert len(found) >= 2
    for one in found:
        assert_agreement(one, archive.tolerance)


@pytest.mark.long
def test_windows_of_a_mission_that_were_not_retracted(twin, paper):
    archive = Archive(paper, twin)
    checked = 0
    for number in (1, 3):
        windows = archive.windows(number)
        whole = windows.isel(window=np.flatnonzero(windows["retracted"].values == 0))
        for found in archive.recompute(number, whole):
            assert_agreement(found, archive.tolerance)
            checked += 1
    assert checked >= 8


def test_joining_changes_the_optimality_of_windows_little(twin, recommended):
    """Blending and steering change most windows by less than the tolerance does, and none by far more."""
    archive = Archive(recommended, twin)
    found = [one for number in (1, 3) for one in archive.recompute(number, archive.windows(number))]
    costs = np.array([(one.cost, one.stored_cost) for one in found])
    measures = np.array([one.measure for one in found])
    assert len(found) > 150
    assert np.median(np.abs(costs[:, 0] / costs[:, 1] - 1.0)) < 0.02
    assert costs[:, 0].sum() < 1.05 * costs[:, 1].sum()
    assert np.mean(measures <= archive.tolerance * (1.0 + ROUNDING)) > 0.7
    assert measures.max() < 10.0 * archive.tolerance


@pytest.mark.parametrize("preset", ["recommended", "paper"])
def test_stored_measure_and_outcome_agree_in_every_window(request, twin, preset):
    archive = Archive(request.getfixturevalue(preset), twin)
    table = archive.tree.to_dataset()
    for number in (1, 2, 3, 4):
        windows = archive.windows(number)
        converged = windows["outcome"].values == OUTCOME.meanings["converged"]
        np.testing.assert_array_equal(converged, windows["gradient_norm"].values <= archive.tolerance)
        assert float(table["converged_fraction"].sel(profile=number)) == converged.mean()
        assert converged.mean() >= 0.9


def test_a_window_cut_off_is_not_called_converged(brief, tmp_path):
    """One iteration is not enough; windows that meet the measure by chance are converged, all others have a reason."""
    store = tmp_path / "cut.zarr"
    answer = program(
        "run-mission", brief, "--platform", "petrel-l", "--store", store, "--workers", 0, "--profiles", 2,
        "--preset", "paper", "--set", "optimizer.max_iterations=1", "--set", "window.margin=0",
    )  # fmt: skip
    assert answer.status == 0, "windows that do not converge cost no profile"
    archive = Archive(store, brief)
    windows = archive.windows(2)
    assert (windows["iterations"].values <= 1).all()
    outcomes = {archive.names[int(value)] for value in windows["outcome"].values}
    assert "iteration_limit" in outcomes
    assert outcomes <= {"iteration_limit", "converged", "diverged"}
    stands = np.array([archive.names[int(value)] != "diverged" for value in windows["outcome"].values])
    assert stands.sum() > 9
    for found in archive.recompute(2, windows.isel(window=stands)):
        assert_agreement(found, archive.tolerance)
    flagged = archive.tree["series"].ds["quality"].sel(profile=2).values.astype(int) & 64 > 0
    for window in range(windows.sizes["window"]):
        one = windows.isel(window=window)
        span = slice(int(one["start"]), int(one["stop"]))
        assert (flagged[span] == (archive.names[int(one["outcome"])] != "converged")).all()


def test_the_tolerance_is_a_setting(brief, tmp_path):
    """A tolerance a hundred times as large is met sooner, and is stored in the archive."""
    store = tmp_path / "loose.zarr"
    estimate(brief, store, "paper", {"optimizer.tolerance": "0.1"})
    archive = Archive(store, brief)
    windows = archive.windows(1)
    assert archive.settings.optimizer.tolerance == 0.1
    norms = windows["gradient_norm"].values
    assert (norms <= 0.1).all()
    assert (norms > 1e-3).any()
    assert (windows["outcome"].values == OUTCOME.meanings["converged"]).all()
