"""``twin sensitivity``: what noise, offsets, wrong coefficients, steps and gaps do to the answer (section 5.1.1).

Every disturbed run has a twin without that one error: the same dive, the same noise. Biases are differences of the two,
so that neither the estimator's own error nor the truth enters.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from gliderhpc.analysis.study_output import Comparison
from gliderhpc.analysis.twin.changes import RecordChanges
from gliderhpc.analysis.twin.hulls import COEFFICIENTS, with_coefficient_errors, with_factors, with_sample_interval
from gliderhpc.analysis.twin.inversion import TwinCase
from gliderhpc.analysis.twin.runs import Report, Row, TwinRun, labelled, run_all
from gliderhpc.analysis.twin.worlds import QUIET, course_of, noiseless, world
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.mission.executors import Executor
from gliderhpc.observations.synthetic import Scenario
from gliderhpc.platform import Platform
from gliderhpc.store_schema.schema import CHANNELS

PRESETS = ("recommended", "paper")
PITCHES = (23.0, 35.0)
"""Of the twins with offsets, degree: the usual glide and a steep one."""

COEFFICIENT_ERROR = 0.15
OFFSETS = ("pitch", "heading", "roll")
STEPS = (0.05, 0.2, 0.25)
INTERVALS = (2.0, 4.0, 5.0, 10.0, 20.0)
DROPOUTS = (0.05, 0.2, 0.5)
GAPS = (5.0, 10.0, 30.0, 60.0)
INITIAL_ERRORS = {"u": (6, 0.1), "v": (7, 0.05), "w": (8, 0.05), "q": (10, 0.02), "r": (11, 0.02)}
"""Index in the state (eq. 16) and error, m/s or rad/s."""

BASE = "base"
_COEFFICIENT_STREAM = 2_000

SUMMARISED = (
    *(f"rmse_{name}" for name in CHANNELS), "correlation_B_cr", "noise_B_cr", "peak_B_cr", "tracking_roll",
    "tracking_pitch", "tracking_heading", "tracking_depth", "velocity_along", "velocity_error", "surge_rmse",
    "iterations", "capped",
)  # fmt: skip


@dataclass(frozen=True)
class SensitivitySize:
    """How much is run.

    Attributes
    ----------
    depth, noise_depth : float
        Of the twins, and of those without any disturbance, m.
    seeds : int
        Twins.
    draws : int
        Draws of all coefficients a twin.
    presets, pitches, single_coefficients : tuple
        Presets, pitches of the twins with offsets (degree), coefficients that are also made wrong alone.
    """

    depth: float
    noise_depth: float
    seeds: int
    draws: int
    presets: tuple[str, ...]
    pitches: tuple[float, ...]
    single_coefficients: tuple[str, ...]


FULL = SensitivitySize(120.0, 300.0, 10, 4, PRESETS, PITCHES, COEFFICIENTS)
QUICK = SensitivitySize(40.0, 60.0, 2, 2, PRESETS, PITCHES[:1], ("K_D0", "K_L"))


@dataclass(frozen=True, eq=False)
class SensitivityStudy:
    """What the study gives: a row a run, medians a setting, and the biases that each error causes."""

    rows: list[Row]
    summary: list[Row]
    biases: list[Row]


def study_sensitivity(
    platform: Platform, size: SensitivitySize, seeds: Iterable[int], executor: Executor, report: Report
) -> SensitivityStudy:
    """Run everything on one hull."""
    rows = run_all(sensitivity_runs(platform, size, seeds), executor, report)
    return SensitivityStudy(rows, summarise(rows), biases(rows))


def sensitivity_runs(platform: Platform, size: SensitivitySize, seeds: Iterable[int]) -> list[TwinRun]:
    """List every run, those of one twin together."""
    return [
        run
        for seed in seeds
        for preset in size.presets
        for run in (
            *_noise_runs(platform, size, seed, preset),
            *_offset_runs(platform, size, seed, preset),
            *_record_runs(platform, size, seed, preset),
            *_coefficient_runs(platform, size, seed, preset),
        )
    ]


def _noise_runs(platform: Platform, size: SensitivitySize, seed: int, preset: str) -> list[TwinRun]:
    quiet = world(size.noise_depth, disturbances=QUIET)
    return [
        _run(platform, scenario, seed, preset, sweep="quiet", value=value)
        for value, scenario in (("noise", quiet), ("perfect sensors", noiseless(quiet)))
    ]


def _offset_runs(platform: Platform, size: SensitivitySize, seed: int, preset: str) -> list[TwinRun]:
    runs = []
    for pitch in size.pitches:
        scenario = world(size.depth, pitch=pitch)
        runs.append(_run(platform, scenario, seed, preset, sweep=f"offset at {pitch:g}", value=BASE))
        for name in OFFSETS:
            for sign in (1.0, -1.0):
                changes = RecordChanges(**{f"{name}_offset": sign})
                labels: dict[str, Any] = {"sweep": f"offset at {pitch:g}", "value": f"{name} {sign:+g}"}
                runs.append(_run(platform, scenario, seed, preset, changes=changes, **labels))
    return runs


def _record_runs(platform: Platform, size: SensitivitySize, seed: int, preset: str) -> list[TwinRun]:
    """Steps, sample intervals, dropouts, gaps and the first guess of the state, on the usual twin."""
    scenario = world(size.depth)
    common = (platform, scenario, seed, preset)
    runs = [_run(*common, sweep="usual", value=BASE)]
    runs += [_run(*common, sweep="step", value=step, settings={"step": step}) for step in STEPS]
    runs += [
        _run(
            *common, sweep="sample interval", value=interval, changes=RecordChanges(sample_interval=interval),
            assumed=with_sample_interval(platform, interval),
        )
        for interval in INTERVALS
    ]  # fmt: skip
    runs += [_run(*common, sweep="dropout", value=share, changes=RecordChanges(dropout=share)) for share in DROPOUTS]
    runs += [_run(*common, sweep="gap", value=gap, changes=RecordChanges(gap=gap)) for gap in GAPS]
    runs += [
        _run(*common, sweep="initial state", value=name, initial_error=_initial_error(index, error))
        for name, (index, error) in INITIAL_ERRORS.items()
    ]
    return runs


def _coefficient_runs(platform: Platform, size: SensitivitySize, seed: int, preset: str) -> list[TwinRun]:
    scenario = world(size.depth)
    rng = np.random.default_rng([seed, _COEFFICIENT_STREAM])
    assumed = {
        f"draw {draw + 1}": with_coefficient_errors(platform, COEFFICIENT_ERROR, rng) for draw in range(size.draws)
    }
    runs = [
        _run(platform, scenario, seed, preset, sweep="coefficients", value=value, assumed=hull)
        for value, hull in assumed.items()
    ]
    runs += [
        _run(
            platform, scenario, seed, preset, sweep="one coefficient", value=name,
            assumed=with_factors(platform, {name: 1.0 + COEFFICIENT_ERROR}),
        )
        for name in size.single_coefficients
    ]  # fmt: skip
    return runs


def _initial_error(index: int, error: float) -> tuple[float, ...]:
    return tuple(error if i == index else 0.0 for i in range(12))


def _run(
    platform: Platform,
    scenario: Scenario,
    seed: int,
    preset: str,
    *,
    sweep: str,
    value: Any,
    settings: dict[str, Any] | None = None,
    assumed: Platform | None = None,
    changes: RecordChanges | None = None,
    initial_error: tuple[float, ...] | None = None,
) -> TwinRun:
    validated = EstimationSettings.model_validate({"preset": preset, **(settings or {})})
    case = TwinCase(
        platform, scenario, seed, validated, course_of(seed), assumed, changes or RecordChanges(), initial_error
    )
    return labelled(case, hull=platform.name, preset=preset, sweep=sweep, value=value)


def summarise(rows: Sequence[Row]) -> list[Row]:
    """Median and largest size of every score over the twins, one line a setting, in the order of the runs."""
    frame = _frame(rows)
    frame.loc[frame["sweep"] == "coefficients", "value"] = f"within {COEFFICIENT_ERROR:.0%}"
    lines: list[Row] = []
    for labels, group in frame.groupby(["preset", "sweep", "value"], sort=False):
        line: Row = dict(zip(("preset", "sweep", "value"), labels, strict=True))
        line["runs"] = len(group)
        line["refused"] = int(group["refused"].notna().sum())
        for name in SUMMARISED:
            known = group[name].to_numpy(dtype=np.float64)
            known = known[np.isfinite(known)]
            line[name] = float(np.median(known)) if known.size else float("nan")
            line[f"{name}_most"] = float(np.abs(known).max()) if known.size else float("nan")
        lines.append(line)
    return lines


def biases(rows: Sequence[Row]) -> list[Row]:
    """Mean shift of every channel by every error, dive and climb apart: N and N m, a degree for the offsets.

    Noise: difference from perfect sensors on the quiet twin. Offsets: half the difference between plus and minus one
    degree. All others: difference from the usual twin. One line an error, phase and preset: median over the twins, and
    largest size.
    """
    frame = _frame(rows)
    lines = []
    for preset in frame["preset"].unique():
        ours = frame[frame["preset"] == preset]
        for sweep in ours["sweep"].unique():
            of_sweep = ours[ours["sweep"] == sweep]
            if sweep == "quiet":
                shift = _biases_of(of_sweep, "noise") - _biases_of(of_sweep, "perfect sensors")
                lines += _bias_lines(preset, sweep, "noise", shift)
            elif sweep.startswith("offset"):
                for name in OFFSETS:
                    shift = 0.5 * (_biases_of(of_sweep, f"{name} +1") - _biases_of(of_sweep, f"{name} -1"))
                    lines += _bias_lines(preset, sweep, name, shift)
            elif sweep in ("coefficients", "one coefficient", "initial state", "step", "sample interval"):
                base = _biases_of(ours[ours["sweep"] == "usual"], BASE)
                shifts = {value: _biases_of(of_sweep, value) - base for value in of_sweep["value"].unique()}
                if sweep == "coefficients":
                    lines += _bias_lines(preset, sweep, f"within {COEFFICIENT_ERROR:.0%}", pd.concat(shifts.values()))
                else:
                    for value, shift in shifts.items():
                        lines += _bias_lines(preset, sweep, value, shift)
    return lines


_PHASES = ("dive", "climb")
_BIASES = [f"bias_{phase}_{name}" for phase in _PHASES for name in CHANNELS]


def _frame(rows: Sequence[Row]) -> pd.DataFrame:
    frame = pd.DataFrame(rows)
    if "refused" not in frame:
        frame["refused"] = None
    return frame.astype({"value": "object"})


def _biases_of(frame: pd.DataFrame, value: Any) -> pd.DataFrame:
    """Mean errors a seed, dive and climb."""
    chosen = frame[frame["value"] == value].set_index("seed")
    return pd.DataFrame(chosen[[*_BIASES, "velocity_along", "velocity_across"]].astype(np.float64))


def _bias_lines(preset: str, sweep: str, value: Any, shift: pd.DataFrame) -> list[Row]:
    lines = []
    for phase in _PHASES:
        line: Row = {"preset": preset, "sweep": sweep, "value": value, "phase": phase}
        for name in CHANNELS:
            of_channel = shift[f"bias_{phase}_{name}"].dropna()
            line[name] = float(of_channel.median())
            line[f"{name}_most"] = float(of_channel.abs().max())
            line[f"{name}_rms"] = float(np.sqrt((of_channel**2).mean()))
        line["velocity_along_rms"] = float(np.sqrt((shift["velocity_along"] ** 2).mean()))
        line["velocity_across_rms"] = float(np.sqrt((shift["velocity_across"] ** 2).mean()))
        lines.append(line)
    return lines


def compare_sensitivity(study: SensitivityStudy, preset: str) -> list[Comparison]:
    """Lay the paper's figures of section 5.1.1 beside ours, for one preset."""
    summary = {(line["sweep"], line["value"]): line for line in study.summary if line["preset"] == preset}
    shifts = {(line["sweep"], line["value"], line["phase"]): line for line in study.biases if line["preset"] == preset}
    return [
        *_noise_comparisons(summary, shifts["quiet", "noise", "dive"]),
        *_offset_comparisons(shifts),
        *_coefficient_comparisons(shifts),
        *_record_comparisons(summary),
    ]


def _noise_comparisons(summary: dict[tuple[str, Any], Row], shift: Row) -> list[Comparison]:
    noise, perfect = summary["quiet", "noise"], summary["quiet", "perfect sensors"]
    least = Comparison(
        "noise: yaw moment, largest", "N m", noise["peak_B_cr_most"], 0.24, paper_said="<= 0.24",
        remark=f"high-passed, over all twins; perfect sensors {perfect['peak_B_cr_most']:.3f}",
    )  # fmt: skip
    channels = [
        Comparison(
            f"noise: {name} left, RMS", unit, noise[f"rmse_{name}"], remark=f"perfect {perfect[f'rmse_{name}']:.2g}"
        )
        for name, (unit, _) in CHANNELS.items()
    ]
    velocity = Comparison(
        "noise: mean velocity through the water", "m/s",
        float(np.hypot(shift["velocity_along_rms"], shift["velocity_across_rms"])), 2e-4,
        remark=f"RMS difference from perfect sensors, whose own error is {perfect['velocity_error']:.1e}",
    )  # fmt: skip
    return [least, *channels, velocity]


_PAPER_OFFSETS = {("pitch", "B_cu"): 0.43, ("pitch", "B_cq"): 0.11, ("heading", "B_cr"): 0.003}


def _offset_comparisons(shifts: dict[tuple[str, Any, str], Row]) -> list[Comparison]:
    rows = []
    for sweep in dict.fromkeys(key[0] for key in shifts if key[0].startswith("offset")):
        for name, channels in (("pitch", ("B_cu", "B_cw", "B_cq", "B_cr")), ("heading", ("B_cu", "B_cw", "B_cr"))):
            for channel in channels:
                for phase in _PHASES:
                    line = shifts[sweep, name, phase]
                    unit = f"{CHANNELS[channel][0]}/degree"
                    paper = _PAPER_OFFSETS.get((name, channel)) if phase == "dive" else None
                    rows.append(Comparison(f"{name} {sweep} degree: {channel}, {phase}", unit, line[channel], paper))
    return rows


def _coefficient_comparisons(shifts: dict[tuple[str, Any, str], Row]) -> list[Comparison]:
    rows = []
    value = f"within {COEFFICIENT_ERROR:.0%}"
    for phase in _PHASES:
        line = shifts["coefficients", value, phase]
        rows += [
            Comparison(
                f"coefficients {value}: {name}, {phase}", CHANNELS[name][0], line[f"{name}_rms"],
                remark=f"RMS; most {line[f'{name}_most']:.2f}",
            )
            for name in ("B_cu", "B_cw", "B_cq", "B_cr")
        ]  # fmt: skip
    line = shifts["coefficients", value, "dive"]
    rows.append(Comparison(f"coefficients {value}: velocity along track", "m/s", line["velocity_along_rms"], 0.055,
                           paper_said="0.05-0.06 in all", remark="RMS of the shift"))  # fmt: skip
    return rows


def _record_comparisons(summary: dict[tuple[str, Any], Row]) -> list[Comparison]:
    base = summary["usual", BASE]
    rows = [Comparison("usual twin: yaw RMSE", "N m", base["rmse_B_cr"])]
    for (sweep, value), line in summary.items():
        if sweep in ("step", "sample interval", "dropout", "gap", "initial state"):
            label = f"{value:g}" if isinstance(value, float) else str(value)
            rows.append(
                Comparison(
                    f"{sweep} {label}: yaw RMSE", "N m", line["rmse_B_cr"],
                    remark=f"surge {line['rmse_B_cu']:.3f} N, velocity {line['velocity_error']:.4f} m/s, "
                    f"refused {line['refused']}",
                )
            )  # fmt: skip
    return rows
