"""Measured profiles compared with nulls: the ensembles, the nulls' ceiling, and the verdict on turbulence.

The paper requires three features together. Each is passed, failed or not tested. A feature is passed only if every
profile shows it; a statistic that the records do not resolve is not tested. One feature that is not passed refutes the
claim. A test that has its nominal level on nulls (`contrast`), and a conclusion in three sentences, are added.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.archive.reader import Archive
from gliderhpc.findings.findings import number
from gliderhpc.store_schema.columns import GAUSSIAN, MODEL_ERROR, NOISE_ONLY, REALISATIONS
from gliderhpc.store_schema.schema import COMPLETE
from gliderhpc.studies.archived import as_cells, failed_profiles, study_table
from gliderhpc.studies.library.turbulence.contrast import LEVEL, POWER, Contrast, NullPasses, contrast_of
from gliderhpc.studies.library.turbulence.series import MIN_RMS, FastSettings, IntermittencySettings
from gliderhpc.vocabulary import she_leveque

Array = NDArray[np.float64]

ARTEFACTS = (NOISE_ONLY, MODEL_ERROR)
"""Families of nulls without any disturbance, which determine the ceiling; a Gaussian null has a disturbance."""

SHE_LEVEQUE = she_leveque(6.0)
TOLERANCE = 0.05
"""Largest distance of an exponent from She and Leveque's that the paper regards as turbulence."""

PASSED, FAILED, NOT_TESTED = "passed", "failed", "not tested"

ASSUMPTIONS = (
    "the profiles are independent of each other; the same hull, sensors and settings may bias all of them in the same "
    "way, and agreement among them would then be no evidence",
    "the exponents of the nulls are a sample of those that artefacts give in each of these profiles; with so few "
    "realisations the share inside the cluster is uncertain, and its power with the number of profiles as exponent "
    "much more so",
    "the cluster (1.78 within 0.05), the lags of the fit and the band were fixed before the data were seen; results "
    "for other lags are in the study's table of ranges",
    "the probability is that of one feature under one hypothesis, artefacts of the kinds tested, and not the "
    "probability that the events are turbulence",
    "a passed rank test excludes a Gaussian linear process seen through a fixed distortion, and nothing else: a train "
    "of independent impulses, a sensor's false samples or a variance that changes along the profile may pass it too",
)
"""Assumptions of the joint statement."""


# Ensembles


@dataclass(frozen=True, eq=False)
class Ensembles:
    """Measured profiles and nulls of a mission.

    Attributes
    ----------
    measured : pandas.DataFrame
        Table of group ``intermittency``, one row for each profile.
    nulls : pandas.DataFrame
        Table of group ``nulls``, one row for each realisation; empty if there are none.
    settings : IntermittencySettings
        Settings of both.
    """

    measured: pd.DataFrame
    nulls: pd.DataFrame
    settings: IntermittencySettings

    def family(self, name: str) -> pd.DataFrame:
        """Realisations of a family that have statistics."""
        if self.nulls.empty:
            return self.nulls
        return pd.DataFrame(self.nulls.loc[(self.nulls["family"] == name) & (self.nulls["rms"] > MIN_RMS)])

    @property
    def artefacts(self) -> pd.DataFrame:
        """Realisations without any disturbance that have statistics."""
        return pd.concat([self.family(name) for name in ARTEFACTS]) if len(self.nulls) else self.nulls

    @property
    def ceiling(self) -> float:
        """Largest magnitude in the nulls without any disturbance, in the channel's unit; NaN without nulls."""
        return float(self.artefacts["peak"].max()) if len(self.artefacts) else float("nan")

    def measured_values(self, name: str) -> Array:
        """Finite values of a statistic of the measured profiles."""
        if self.measured.empty or name not in self.measured:
            return np.empty(0)
        return _finite(self.measured[name])


def null_table(archive: Archive) -> pd.DataFrame:
    """Return the table of an archive's nulls, one row for each realisation."""
    group = archive["nulls"].to_dataset()
    columns = [variable.name for variable in REALISATIONS if variable.name in group]
    return pd.DataFrame({name: as_cells(group[name].values) for name in columns})


def stored_nulls(
    archive: Archive, estimate: str, settings: IntermittencySettings
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Return an archive's nulls for an estimate and settings, and a remark if there are none."""
    attributes = _attributes(archive, "nulls")
    if not attributes.get(COMPLETE, False):
        return pd.DataFrame(), ("there are no nulls to compare the amplitudes with; run the study nulls",)
    if attributes.get("estimate") != estimate:
        return pd.DataFrame(), (
            f"the archive's nulls are of the {attributes.get('estimate')} estimate; run nulls again",
        )
    if not is_comparable(attributes.get("settings", {}).get("statistics", {}), settings):
        return pd.DataFrame(), ("the archive's nulls were made with other settings; run nulls again",)
    return null_table(archive), ()


def stored_measured(archive: Archive, estimate: str) -> tuple[pd.DataFrame, IntermittencySettings | None]:
    """Return an archive's measured profiles for an estimate, and their settings, which are None if there are none."""
    attributes = _attributes(archive, "intermittency")
    if not attributes.get(COMPLETE, False) or attributes.get("estimate") != estimate:
        return pd.DataFrame(), None
    _, studied = failed_profiles(study_table(archive, "intermittency"))
    return studied.reset_index(drop=True), IntermittencySettings.model_validate(attributes["settings"])


def is_comparable(stored: object, settings: IntermittencySettings) -> bool:
    """Return whether stored settings give the same statistics: all must agree except seeds and numbers of draws."""
    own = settings.model_dump(mode="json")
    free = {"seed", "draws", "block_draws", "surrogates", "groups"}
    return isinstance(stored, dict) and all(stored.get(key) == value for key, value in own.items() if key not in free)


def _attributes(archive: Archive, name: str) -> dict[str, Any]:
    return {str(key): value for key, value in archive[name].attrs.items()} if name in archive.children else {}


# The nulls' ceiling


@dataclass(frozen=True)
class NullFloor:
    """Magnitudes without turbulence: the nulls' ceiling, and the root mean square due to sensor noise alone."""

    ceiling: float
    noise: float


def null_floor(archive: Archive, estimate: str, settings: FastSettings) -> tuple[NullFloor | None, tuple[str, ...]]:
    """Return ceiling and noise of an archive's nulls of the same channel and high-pass, or None and the reason."""
    own_noise = "events are ranked by each profile's own noise floor"
    attributes = _attributes(archive, "nulls")
    if not attributes.get(COMPLETE, False) or attributes.get("estimate") != estimate:
        return None, (f"there are no nulls of this estimate: {own_noise}; run the study nulls",)
    made = IntermittencySettings.model_validate(attributes["settings"]["statistics"])
    if (made.channel, made.cutoff) != (settings.channel, settings.cutoff):
        return None, (f"the archive's nulls are of another channel or high-pass: {own_noise}",)
    ensembles = Ensembles(pd.DataFrame(), null_table(archive), made)
    if not np.isfinite(ensembles.ceiling):
        return None, (f"none of the archive's nulls has statistics, so there is no ceiling: {own_noise}",)
    noise = ensembles.family(NOISE_ONLY)
    floor = noise if len(noise) else ensembles.artefacts
    return NullFloor(ensembles.ceiling, float(floor["rms"].median())), ()


# The verdict


@dataclass(frozen=True)
class Feature:
    """One of the paper's three features: name, outcome, and the figures from which the outcome follows."""

    name: str
    outcome: str
    figures: str


@dataclass(frozen=True)
class TurbulenceVerdict:
    """Features and joint statement.

    Attributes
    ----------
    features : tuple of Feature
        Exponents, amplitudes, rank test.
    inside : float
        Share of the nulls' exponents inside the cluster, with one added to both numbers because they are small; NaN
        without nulls.
    joint : float
        Probability that as many profiles drawn from the nulls would all lie inside the cluster; NaN without nulls.
    profiles : int
        Number of profiles with statistics.
    contrast : Contrast, optional
        Comparison of the profiles' flatness with that of the Gaussian nulls; None if either is missing.
    null_passes : NullPasses, optional
        Nulls without any disturbance that pass the rank test; None if there are no such nulls.
    """

    features: tuple[Feature, ...]
    inside: float
    joint: float
    profiles: int
    contrast: Contrast | None = None
    null_passes: NullPasses | None = None

    @property
    def stands(self) -> bool:
        """Return whether all features are passed."""
        return all(feature.outcome == PASSED for feature in self.features)

    @property
    def sentence(self) -> str:
        """Verdict in one line."""
        outcomes = ", ".join(f"{feature.name} {feature.outcome}" for feature in self.features)
        conclusion = (
            "the three features of the paper are present" if self.stands else "the claim of turbulence is not supported"
        )
        return f"verdict over {self.profiles} profiles: {conclusion} ({outcomes})"

    def as_json(self) -> dict[str, Any]:
        """Return the verdict as plain values."""
        return {
            "features": [{"name": f.name, "outcome": f.outcome, "figures": f.figures} for f in self.features],
            "stands": self.stands,
            "null_share_inside": self.inside,
            "joint_probability": self.joint,
            "assumptions": list(ASSUMPTIONS),
            "flatness_contrast": None if self.contrast is None else asdict(self.contrast),
            "conclusion": list(conclusion(self)),
        }


def judge(ensembles: Ensembles) -> TurbulenceVerdict:
    """Determine the verdict on the measured profiles of a mission."""
    features = (_exponents(ensembles), _amplitudes(ensembles), _rank_test(ensembles))
    inside, joint = _joint_probability(ensembles)
    return TurbulenceVerdict(
        features, inside, joint, len(ensembles.measured), _flatness_contrast(ensembles), _null_passes(ensembles)
    )


def _flatness_contrast(ensembles: Ensembles) -> Contrast | None:
    nulls = ensembles.family(GAUSSIAN)
    if not len(nulls):
        return None
    return contrast_of(ensembles.measured_values("flatness"), _finite(nulls["flatness"]))


def _null_passes(ensembles: Ensembles) -> NullPasses | None:
    if not len(ensembles.artefacts):
        return None
    values, level = _finite(ensembles.artefacts["p_value"]), 1.0 / (1 + ensembles.settings.surrogates)
    return NullPasses(int((values <= level + 1e-9).sum()), len(values), level) if len(values) else None


def conclusion(verdict: TurbulenceVerdict) -> tuple[str, str, str]:
    """Return three sentences: the finding, its certainty, and the data or instrument that would settle the question."""
    return _found(verdict), _how_sure(verdict), _what_would_settle_it(verdict)


def _found(verdict: TurbulenceVerdict) -> str:
    passed = [feature.name for feature in verdict.features if feature.outcome == PASSED]
    features = f"{len(passed)} of the publication's {len(verdict.features)} features"
    text = f"Found: {features}" + (f" ({', '.join(passed)})" if passed else "")
    if verdict.contrast is None:
        return f"{text}."
    return (
        f"{text}, and a flatness larger than that of Gaussian disturbances seen through the same pipeline in "
        f"{number(verdict.contrast.larger)} of pairs of a profile and a null (one half is expected by chance)."
    )


def _how_sure(verdict: TurbulenceVerdict) -> str:
    contrast, passes = verdict.contrast, verdict.null_passes
    parts = []
    if contrast is not None:
        parts.append(
            f"{contrast.profiles} profiles of Gaussian disturbances would exceed {contrast.nulls} nulls by as much "
            f"with p = {number(contrast.p_value)}"
        )
    if passes is not None:
        use = "as its level allows" if passes.holds else "more than its level allows, so the test decides nothing here"
        parts.append(
            f"{passes.passed} of {passes.count} nulls without any disturbance pass the publication's rank test, {use}"
        )
    return f"How sure: {'; '.join(parts) if parts else 'not known, as there are no nulls of these settings'}."


def _what_would_settle_it(verdict: TurbulenceVerdict) -> str:
    contrast, start = verdict.contrast, "What would settle it:"
    if contrast is None:
        return f"{start} nulls with a Gaussian disturbance (study nulls), and profiles that resolve the flatness."
    if not contrast.can_decide:
        return f"{start} more profiles and nulls; so few cannot reach p = {LEVEL:g} however they differ."
    if contrast.p_value <= LEVEL:
        return (
            f"{start} against a Gaussian disturbance this is settled at {LEVEL:.0%}; against trains of impulses, false "
            "samples and a variance that changes, a microstructure sensor on the same dive."
        )
    if contrast.larger > 0.5:
        return (
            f"{start} about {contrast.profiles_needed:.0f} profiles and as many nulls, among which a difference as "
            f"large as this is found at {LEVEL:.0%} in {POWER:.0%} of cases if it is real (Noether 1987)."
        )
    return (
        f"{start} not more profiles like these, because their flatness is no larger than the nulls'; possibly records "
        "that resolve more of the gusts, sampled faster and with a finer compass."
    )


def _exponents(ensembles: Ensembles) -> Feature:
    name = "consistent exponents"
    values = ensembles.measured_values("zeta_ratio")
    if not len(values) or len(values) < len(ensembles.measured):
        return Feature(name, NOT_TESTED, "zeta_6 / zeta_3 is not resolved in every profile")
    near = np.abs(values - SHE_LEVEQUE) <= TOLERANCE
    spread = f" +- {number(float(values.std(ddof=1)))}" if len(values) > 1 else ""
    figures = (
        f"zeta_6 / zeta_3 = {number(float(values.mean()))}{spread}, {int(near.sum())} of {len(values)} within "
        f"{TOLERANCE:g} of {SHE_LEVEQUE:.2f}"
    )
    return Feature(name, PASSED if near.all() else FAILED, figures)


def _amplitudes(ensembles: Ensembles) -> Feature:
    name = "amplitudes above the null ceiling"
    values, ceiling = ensembles.measured_values("peak"), ensembles.ceiling
    if not len(values) or not np.isfinite(ceiling):
        return Feature(name, NOT_TESTED, "there are no nulls of these settings")
    above = values > ceiling
    figures = (
        f"ceiling {number(ceiling)}, amplitudes {number(float(values.min()))} to {number(float(values.max()))}, "
        f"{int(above.sum())} of {len(values)} above"
    )
    return Feature(name, PASSED if above.all() else FAILED, figures)


def _rank_test(ensembles: Ensembles) -> Feature:
    name = "surrogate test"
    values, level = ensembles.measured_values("p_value"), 1.0 / (1 + ensembles.settings.surrogates)
    if not len(values) or len(values) < len(ensembles.measured):
        return Feature(name, NOT_TESTED, f"F({ensembles.settings.lag:g} s) is not resolved in every profile")
    passed = values <= level + 1e-9
    figures = f"{int(passed.sum())} of {len(values)} above all surrogates, p = {number(level)}"
    nulls = _null_passes(ensembles)
    if nulls is not None:
        figures += f"; so are {nulls.passed} of {nulls.count} nulls"
    return Feature(name, PASSED if passed.all() else FAILED, figures)


def _joint_probability(ensembles: Ensembles) -> tuple[float, float]:
    """Share of the nulls inside the cluster, and the probability that as many as there are profiles all lie there."""
    artefacts = ensembles.artefacts
    if not len(artefacts) or not len(ensembles.measured):
        return float("nan"), float("nan")
    values = _finite(artefacts["zeta_ratio"])
    inside = (1.0 + np.count_nonzero(np.abs(values - SHE_LEVEQUE) <= TOLERANCE)) / (1.0 + len(values))
    return float(inside), float(inside ** len(ensembles.measured))


def _finite(column: pd.Series) -> Array:
    values: Array = column.to_numpy(dtype=np.float64)
    return values[np.isfinite(values)]
