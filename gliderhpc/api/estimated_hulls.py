"""Hulls estimated by a calibration or a tuning, and their files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from gliderhpc.errors import CalibrationError, InputError
from gliderhpc.flight import glider
from gliderhpc.mission.dive_calibration import DiveCalibration
from gliderhpc.output_files import check_output, output_file, write_text
from gliderhpc.platform import Platform, platform_yaml
from gliderhpc.report import calibration as calibration_report
from gliderhpc.report import hull_rounds as rounds_report
from gliderhpc.report import tuning as tuning_report
from gliderhpc.tuning.calibration import Calibration
from gliderhpc.tuning.calibration_score import Score
from gliderhpc.tuning.disturbance_prior import TunedPrior, TuneSettings
from gliderhpc.vocabulary import CHANNELS

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


@dataclass(frozen=True, eq=False)
class CalibratedHull(EstimatedHull):
    """Calibrated hull.

    Attributes
    ----------
    platform : Platform
        Hull with the estimates and their errors.
    calibration : Calibration, optional
        Calibration on the steady glides; None if `dives` is given.
    dives : DiveCalibration, optional
        Calibration on whole dives; None if no rounds were requested or they found no better hull.
    failure : str
        Reason why the dives gave no better hull; otherwise empty.
    caution : str
        Caution about the intervals if the starting platform was itself calibrated; else empty.
    """

    calibration: Calibration | None
    dives: DiveCalibration | None = None
    failure: str = ""
    caution: str = ""

    @property
    def table(self) -> pd.DataFrame:
        """One row per parameter: unit, before, after, 95 % interval, and a remark.

        For whole dives the table includes the remaining part of the plausible deviation; for the steady glides alone,
        the share of scatter between profiles.
        """
        if self.dives is not None:
            return rounds_report.parameter_table(self.dives.rounds)
        found = self.steady.parameters
        return pd.DataFrame(
            {
                "unit": [p.parameter.unit for p in found],
                "before": [p.before for p in found],
                "after": [p.after for p in found],
                "low": [p.interval[0] for p in found],
                "high": [p.interval[1] for p in found],
                "scatter": [p.scatter_share for p in found],
                "remark": [calibration_report.remark_of(p) for p in found],
            },
            index=pd.Index([p.parameter.key for p in found], name="parameter"),
        )

    @property
    def history(self) -> pd.DataFrame:
        """One row per dive and parameter: estimates from all dives and from those up to it, with standard deviations.

        Raises
        ------
        InputError
            There were no rounds over the dives, or they found no better hull.
        """
        if self.dives is None:
            raise InputError(
                "history: a fit of the steady glides alone has none; calibrate with rounds.most above zero"
            )
        return rounds_report.history_table(self.dives.rounds)

    @property
    def fitted(self) -> Score:
        """Errors of the steady balance on the fitted profiles."""
        return self.steady.fitted if self.dives is None else self.dives.fitted

    @property
    def held_out(self) -> Score:
        """Errors of the steady balance on the held-out profiles; without segments if none were held out."""
        return self.steady.held_out if self.dives is None else self.dives.held_out

    @property
    def scores(self) -> pd.DataFrame:
        """Root mean square errors of the balance, before and after, on the fitted and the held-out profiles."""
        rows = {
            (name, when): calibration_report.IN_UNITS * values
            for name, score in (("fitted", self.fitted), ("held out", self.held_out))
            if score.segments
            for when, values in (("before", score.before), ("after", score.after))
        }
        index = pd.MultiIndex.from_tuples(list(rows), names=["profiles", "when"])
        return pd.DataFrame(list(rows.values()), index=index, columns=list(calibration_report.SCORES[2:]))

    @property
    def notes(self) -> list[str]:
        """Remarks that supplement the tables."""
        if self.dives is None:
            lines = calibration_report.notes(self.steady)
        else:
            lines = rounds_report.notes(self.dives.rounds, self.dives.tolerance)
            lines += calibration_report.score_notes(self.fitted, self.held_out)
        return [*lines, *(f"WARNING: {text}" for text in self.warnings)]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the hull or its intervals: `failure` and `caution`, if any."""
        return tuple(filter(None, (self.failure, self.caution)))

    @property
    def steady(self) -> Calibration:
        """Calibration on the steady glides, if there is none on whole dives."""
        assert self.calibration is not None, "one of the two exists"
        return self.calibration


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
            "remark": [tuning_report.remark_of(verdict) for verdict in self.tuned.verdicts],
        }
        index = pd.MultiIndex.from_product([("deviation", "correlation time"), tuple(CHANNELS)])
        return pd.DataFrame(columns, index=index.set_names(["quantity", "channel"]))

    @property
    def notes(self) -> list[str]:
        """Remarks on the gain in likelihood, and on whether the maximum was reached."""
        interpolated = [tuning_report.INTERPOLATED] if self.tuned.interpolated else []
        return [tuning_report.closing_text(self.tuned, self.settings), *interpolated]


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


def write_history(path: Path, found: CalibratedHull, overwrite: bool) -> None:
    """Write the parameters dive by dive as CSV, completely or not at all.

    Raises
    ------
    InputError
        The calibration has no history, or the file cannot be written.
    """
    content = found.history.to_csv(index=False, float_format="%.8g")
    write_text(path, content, overwrite=overwrite)
