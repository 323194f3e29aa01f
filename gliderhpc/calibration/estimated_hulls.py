"""Hulls estimated by a calibration or a tuning, and their files."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from gliderhpc.calibration.dives import text as dives_text
from gliderhpc.calibration.dives.fit import DiveCalibration
from gliderhpc.calibration.glides import text as glides_text
from gliderhpc.calibration.glides.fit import GlideCalibration
from gliderhpc.calibration.glides.score import Score
from gliderhpc.calibration.prior import text as prior_text
from gliderhpc.calibration.prior.fit import TunedPrior, TuneSettings
from gliderhpc.errors import CalibrationError, InputError
from gliderhpc.flight import glider
from gliderhpc.output_files import check_output, output_file, write_text
from gliderhpc.platform import Platform, platform_yaml
from gliderhpc.vocabulary import CHANNELS
from gliderhpc.wording import capitalised

_MAX_ERROR = 100.0
"""Largest error of a logarithm that is shown as a factor; a number without information has none."""


@dataclass(frozen=True, eq=False)
class EstimatedHull:
    """Hull estimated from a mission's records.

    Attributes
    ----------
    platform : Platform
        The hull; its `source` names the records.
    """

    platform: Platform

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the platform file, completely or not at all.

        Raises
        ------
        InputError
            The file exists and `overwrite` is not set, or it cannot be written.
        CalibrationError
            The platform could not be loaded again.
        """
        check_output(Path(path), overwrite=overwrite, instead="another `path`")
        return write_platform(Path(path), self.platform, overwrite)


@dataclass(frozen=True, eq=False, kw_only=True)
class CalibratedHull(EstimatedHull, ABC):
    """Calibrated hull: `HullFromGlides` or `HullFromDives`.

    Attributes
    ----------
    platform : Platform
        Hull with the estimates and their errors.
    failure : str
        Reason why the dives gave no better hull than the steady glides; otherwise empty.
    caution : str
        Caution about the intervals if the starting platform was itself calibrated; else empty.
    change : str
        Warning of a change of the hull among the dives; else empty.
    """

    failure: str = ""
    caution: str = ""
    change: str = ""

    @property
    @abstractmethod
    def table(self) -> pd.DataFrame:
        """One row per parameter: unit, before, after, 95 % interval, and a remark.

        For whole dives the table includes the remaining part of the plausible deviation; for the steady glides alone,
        the share of scatter between profiles.
        """

    @property
    @abstractmethod
    def history(self) -> pd.DataFrame:
        """One row per dive and parameter: estimates from all dives and from those up to it, with standard deviations.

        Raises
        ------
        InputError
            There were no rounds over the dives, or they found no better hull.
        """

    @property
    @abstractmethod
    def fitted(self) -> Score:
        """Errors of the steady balance on the fitted profiles."""

    @property
    @abstractmethod
    def held_out(self) -> Score:
        """Errors of the steady balance on the held-out profiles; without segments if none were held out."""

    @property
    def scores(self) -> pd.DataFrame:
        """Root mean square errors of the balance, before and after, on the fitted and the held-out profiles."""
        rows = {
            (name, when): glides_text.IN_UNITS * values
            for name, score in (("fitted", self.fitted), ("held out", self.held_out))
            if score.segments
            for when, values in (("before", score.before), ("after", score.after))
        }
        index = pd.MultiIndex.from_tuples(list(rows), names=["profiles", "when"])
        return pd.DataFrame(list(rows.values()), index=index, columns=list(glides_text.SCORES[2:]))

    @property
    def notes(self) -> list[str]:
        """Remarks that supplement the tables, followed by the warnings."""
        return [*self.remarks, *self.warnings]

    @property
    @abstractmethod
    def remarks(self) -> list[str]:
        """Remarks that supplement the tables."""

    @property
    def warnings(self) -> list[str]:
        """Warnings about the estimates, the hull and its intervals."""
        return [*self._estimate_warnings(), *self._hull_warnings()]

    def _hull_warnings(self) -> list[str]:
        """Those of `failure`, `caution` and `change` that there are."""
        return [text for text in (self.failure, self.caution, self.change) if text]

    @abstractmethod
    def _estimate_warnings(self) -> list[str]:
        """Warnings about the estimates."""

    @abstractmethod
    def provenance(self, observations: str, digest: str, assignments: Sequence[str]) -> str:
        """Describe the calibration for the platform file: name and digest of the records, settings, and estimates."""


@dataclass(frozen=True, eq=False, kw_only=True)
class HullFromGlides(CalibratedHull):
    """Hull calibrated on the steady glides alone.

    Attributes
    ----------
    calibration : GlideCalibration
        Calibration on the steady glides.
    """

    calibration: GlideCalibration

    @property
    def table(self) -> pd.DataFrame:
        """One row per parameter, as described in `CalibratedHull.table`."""
        parameters = self.calibration.parameters
        return pd.DataFrame(
            {
                "unit": [p.parameter.unit for p in parameters],
                "before": [p.before for p in parameters],
                "after": [p.after for p in parameters],
                "low": [p.interval[0] for p in parameters],
                "high": [p.interval[1] for p in parameters],
                "scatter": [p.scatter_share for p in parameters],
                "remark": [glides_text.remark_of(p) for p in parameters],
            },
            index=pd.Index([p.parameter.key for p in parameters], name="parameter"),
        )

    @property
    def history(self) -> pd.DataFrame:
        """Raise `InputError`, since there are no estimates by dive."""
        raise InputError("history: a fit of the steady glides alone has none; calibrate with rounds.most above zero")

    @property
    def fitted(self) -> Score:
        """Errors of the steady balance on the fitted profiles."""
        return self.calibration.fitted

    @property
    def held_out(self) -> Score:
        """Errors of the steady balance on the held-out profiles."""
        return self.calibration.held_out

    @property
    def remarks(self) -> list[str]:
        """Remarks that supplement the tables."""
        return glides_text.notes(self.calibration)

    def _estimate_warnings(self) -> list[str]:
        return glides_text.warnings(self.calibration)

    def provenance(self, observations: str, digest: str, assignments: Sequence[str]) -> str:
        """Describe the calibration, with its warnings."""
        origin = glides_text.provenance(self.calibration, observations, digest, assignments)
        return " ".join([origin, *(f"{capitalised(text)}." for text in self._hull_warnings())])


@dataclass(frozen=True, eq=False, kw_only=True)
class HullFromDives(CalibratedHull):
    """Hull calibrated in rounds over whole dives.

    Attributes
    ----------
    dives : DiveCalibration
        Calibration on the dives.
    """

    dives: DiveCalibration

    @property
    def table(self) -> pd.DataFrame:
        """One row per parameter, as described in `CalibratedHull.table`."""
        return dives_text.parameter_table(self.dives.rounds)

    @property
    def history(self) -> pd.DataFrame:
        """One row per dive and parameter, as described in `CalibratedHull.history`."""
        return dives_text.history_table(self.dives.rounds)

    @property
    def fitted(self) -> Score:
        """Errors of the steady balance on the fitted profiles."""
        return self.dives.fitted

    @property
    def held_out(self) -> Score:
        """Errors of the steady balance on the held-out profiles."""
        return self.dives.held_out

    @property
    def remarks(self) -> list[str]:
        """Remarks that supplement the tables."""
        return dives_text.notes(self.dives.rounds) + glides_text.score_notes(self.fitted, self.held_out)

    def _estimate_warnings(self) -> list[str]:
        convergence = dives_text.warnings(self.dives.rounds, self.dives.tolerance)
        return convergence + glides_text.score_warnings(self.fitted)

    def provenance(self, observations: str, digest: str, assignments: Sequence[str]) -> str:
        """Describe the calibration; its notes include the warnings."""
        scores = (("fitted", self.fitted), ("held out", self.held_out))
        return dives_text.provenance(self.notes, scores, observations, digest, assignments)


@dataclass(frozen=True, eq=False)
class TunedHull(EstimatedHull):
    """Hull with a tuned disturbance prior.

    Attributes
    ----------
    platform : Platform
        Hull with the tuned prior.
    tuned : TunedPrior
        Prior before and after, likelihoods, and whiteness of the innovations.
    profiles : tuple of int
        Profiles on which the prior was tuned.
    settings : TuneSettings
        Settings of the tuning.
    """

    tuned: TunedPrior
    profiles: tuple[int, ...]
    settings: TuneSettings

    @property
    def table(self) -> pd.DataFrame:
        """One row for each number of the prior: unit, before, after, uncertainty as a factor, and a remark."""
        columns = {
            "unit": [unit for unit, *_ in CHANNELS.values()] + ["s"] * len(CHANNELS),
            "before": self.tuned.before.numbers,
            "after": self.tuned.after.numbers,
            "factor": np.exp(np.where(self.tuned.errors < _MAX_ERROR, self.tuned.errors, np.nan)),
            "remark": [prior_text.remark_of(verdict) for verdict in self.tuned.verdicts],
        }
        index = pd.MultiIndex.from_product([("deviation", "correlation time"), tuple(CHANNELS)])
        return pd.DataFrame(columns, index=index.set_names(["quantity", "channel"]))

    @property
    def notes(self) -> list[str]:
        """Remarks on the gain in likelihood, and on whether the maximum was reached, followed by the warnings."""
        interpolated = [prior_text.INTERPOLATED] if self.tuned.interpolated else []
        return [prior_text.closing_text(self.tuned, self.settings), *interpolated, *self.warnings]

    @property
    def warnings(self) -> list[str]:
        """Warnings about the prior."""
        return prior_text.warnings(self.tuned, self.settings)


def write_platform(out: Path, platform: Platform, overwrite: bool) -> Path:
    """Write a platform file completely or not at all, after checking that a run can load it.

    Raises
    ------
    CalibrationError
        A run could not load the file.
    InputError
        The file cannot be written.
    """
    with output_file(out, overwrite=overwrite) as aside:
        aside.write_text(platform_yaml(platform), "utf-8")
        try:
            glider.load_platform(aside)
        except InputError as error:
            raise CalibrationError(
                "the estimated platform could not be used: "
                f"{str(error).removeprefix(f'{aside}: ')}; start from another platform or choose other `profiles`"
            ) from None
    return out


def write_history(path: Path, calibrated: CalibratedHull, overwrite: bool) -> None:
    """Write the parameters dive by dive as CSV, completely or not at all.

    Raises
    ------
    InputError
        The calibration has no history, or the file cannot be written.
    """
    content = calibrated.history.to_csv(index=False, float_format="%.8g")
    write_text(path, content, overwrite=overwrite)
