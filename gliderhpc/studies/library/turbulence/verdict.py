"""Verdict on turbulence: measured profiles compared with nulls.

The paper requires three features together. Each is passed, failed or not tested. A feature is passed only if every
profile shows it; a statistic that the records do not resolve is not tested. One feature that is not passed refutes the
claim. Two comparisons with Gaussian nulls (`gaussianity` and `contrast`), whose level does not depend on the pipeline,
and a conclusion in three sentences are added.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.findings.formatting import number
from gliderhpc.store_schema.columns import GAUSSIAN
from gliderhpc.studies.library.turbulence.contrast import LEVEL, POWER, Contrast, FalsePositives, contrast_of
from gliderhpc.studies.library.turbulence.ensembles import MIN_NULLS, Ensembles, finite
from gliderhpc.studies.library.turbulence.gaussianity import Gaussianity, describe_untested, judged_gaussianity
from gliderhpc.vocabulary import she_leveque
from gliderhpc.wording import counted

Array = NDArray[np.float64]

SHE_LEVEQUE = she_leveque(6.0)
TOLERANCE = 0.05
"""Maximum distance of an exponent from She and Leveque's that the paper regards as turbulence."""

_MIN_P_VALUE = 1e-9
"""P-value below which only this bound is given."""

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
    "passing the rank test rules out only a linear Gaussian process seen through a static nonlinearity: a train of "
    "independent impulses, a sensor's false samples or a variance that changes along the profile may pass it too",
    "lateral disturbances are Gaussian only as far as the force is linear in the gust, the rounding of roll acts like "
    "independent noise, and the strength is constant within some minutes",
)
"""Assumptions of the joint statement."""


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
    null_passes : FalsePositives, optional
        Nulls without any disturbance that pass the rank test; None if there are no such nulls.
    gaussianity : Gaussianity, optional
        Test of the smoother's standardised noise; None if the archive has none.
    """

    features: tuple[Feature, ...]
    inside: float
    joint: float
    profiles: int
    contrast: Contrast | None = None
    null_passes: FalsePositives | None = None
    gaussianity: Gaussianity | None = None

    @property
    def is_supported(self) -> bool:
        """Return whether all features are passed."""
        return all(feature.outcome == PASSED for feature in self.features)

    @property
    def sentence(self) -> str:
        """Verdict in one line."""
        outcomes = ", ".join(f"{feature.name} {feature.outcome}" for feature in self.features)
        conclusion = (
            "the three features of the paper are present"
            if self.is_supported
            else "the claim of turbulence is not supported"
        )
        return f"verdict over {counted(self.profiles, 'profile')}: {conclusion} ({outcomes})"

    def as_json(self) -> dict[str, Any]:
        """Return the verdict as plain values."""
        return {
            "features": [{"name": f.name, "outcome": f.outcome, "figures": f.figures} for f in self.features],
            "stands": self.is_supported,
            "null_share_inside": self.inside,
            "joint_probability": self.joint,
            "assumptions": list(ASSUMPTIONS),
            "flatness_contrast": None if self.contrast is None else asdict(self.contrast),
            "gaussianity": None if self.gaussianity is None else asdict(self.gaussianity),
            "conclusion": list(conclusion(self)),
        }


def judge(ensembles: Ensembles) -> TurbulenceVerdict:
    """Determine the verdict on the measured profiles of a mission."""
    features = (_exponents(ensembles), _amplitudes(ensembles), _rank_test(ensembles))
    inside, joint = _joint_probability(ensembles)
    return TurbulenceVerdict(
        features,
        inside,
        joint,
        len(ensembles.measured),
        _flatness_contrast(ensembles),
        _null_passes(ensembles),
        judged_gaussianity(ensembles.measured, ensembles.family(GAUSSIAN)),
    )


def _flatness_contrast(ensembles: Ensembles) -> Contrast | None:
    nulls = ensembles.family(GAUSSIAN)
    if not len(nulls):
        return None
    return contrast_of(ensembles.measured_values("flatness"), finite(nulls["flatness"]))


def _null_passes(ensembles: Ensembles) -> FalsePositives | None:
    if not len(ensembles.artefacts):
        return None
    values, level = finite(ensembles.artefacts["p_value"]), ensembles.null_level
    return FalsePositives(int((values <= level + 1e-9).sum()), len(values), level) if len(values) else None


def conclusion(verdict: TurbulenceVerdict) -> tuple[str, str, str]:
    """Return three sentences: the finding, its certainty, and the data or instrument that would settle the question."""
    return _describe_finding(verdict), _describe_certainty(verdict), _describe_next_step(verdict)


def _describe_finding(verdict: TurbulenceVerdict) -> str:
    passed = [feature.name for feature in verdict.features if feature.outcome == PASSED]
    features = f"{len(passed)} of the paper's {len(verdict.features)} features"
    parts = [f"Found: {features}" + (f" ({', '.join(passed)})" if passed else "")]
    if verdict.gaussianity is not None:
        parts.append(_describe_noise_finding(verdict.gaussianity))
    if verdict.contrast is not None:
        parts.append(
            f"a flatness larger than that of Gaussian disturbances seen through the same pipeline in "
            f"{number(verdict.contrast.larger)} of pairs of a profile and a null (one half is expected by chance)"
        )
    return f"{'; '.join(parts)}."


def _describe_noise_finding(gaussianity: Gaussianity) -> str:
    untested = f"; {describe_untested(gaussianity)}" if gaussianity.untested else ""
    if not gaussianity.tested:
        why = "" if untested else ", as the roll hardly changes or there are too few samples"
        return f"no profile in which it can be tested whether lateral disturbances are Gaussian{why}{untested}"
    return (
        f"lateral disturbances that are not Gaussian in {gaussianity.rejected} of the "
        f"{counted(gaussianity.tested, 'profile')} in which this can be tested (at {LEVEL:.0%} each){untested}"
    )


def _describe_certainty(verdict: TurbulenceVerdict) -> str:
    contrast, passes = verdict.contrast, verdict.null_passes
    parts = []
    if verdict.gaussianity is not None and verdict.gaussianity.tested:
        parts.append(_describe_noise_certainty(verdict.gaussianity))
    if contrast is not None:
        parts.append(
            f"{counted(contrast.profiles, 'profile')} of Gaussian disturbances would exceed {contrast.nulls} nulls by "
            f"as much with p = {number(contrast.p_value)}"
        )
    if passes is not None:
        use = (
            "consistent with the test's level"
            if passes.holds
            else "more than the test's level allows, so the test is inconclusive here"
        )
        parts.append(
            f"{passes.passed} of {passes.count} nulls without any disturbance pass the paper's rank test, {use}"
        )
    return f"Certainty: {'; '.join(parts) if parts else 'not known, as there are no nulls of these settings'}."


def _describe_noise_certainty(gaussianity: Gaussianity) -> str:
    nulls, contrast = gaussianity.nulls, gaussianity.contrast
    if nulls is None or contrast is None:
        p_value = _p_text(gaussianity.count_p_value)
        return f"this many detections would occur by chance with p = {p_value} if all were Gaussian"
    allowed = (
        "consistent with the test's level"
        if nulls.holds
        else "more than the test's level allows, so rely on the comparison"
    )
    return (
        f"{counted(contrast.profiles, 'profile')} of Gaussian lateral disturbances would exceed the kurtosis of "
        f"{contrast.nulls} nulls by as much with p = {_p_text(contrast.p_value)}, and the test rejects "
        f"{nulls.passed} of these nulls, {allowed}"
    )


def _p_text(p: float) -> str:
    return f"{_MIN_P_VALUE:g} or less" if p <= _MIN_P_VALUE else number(p)


def _describe_next_step(verdict: TurbulenceVerdict) -> str:
    contrast, noise, start = verdict.contrast, verdict.gaussianity, "To settle the question:"
    if noise is not None and noise.rejects_gaussian:
        return (
            f"{start} Gaussian lateral disturbances like the nulls are rejected at the {LEVEL:.0%} level; to exclude "
            "trains of impulses, false samples, actuators that move unrecorded and gusts so strong that their force is "
            "not linear, a microstructure sensor on the same dive is needed."
        )
    if contrast is None:
        return f"{start} nulls with a Gaussian disturbance (study nulls), and profiles that resolve the flatness."
    if not contrast.can_decide:
        return f"{start} more profiles and nulls; so few cannot reach p = {LEVEL:g} however they differ."
    if contrast.p_value <= LEVEL:
        return (
            f"{start} a Gaussian disturbance is rejected at the {LEVEL:.0%} level; to exclude trains of impulses, "
            "false samples and a variance that changes, a microstructure sensor on the same dive is needed."
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
    if ensembles.ceiling_count < MIN_NULLS:
        few = f"{ensembles.ceiling_count} nulls without any disturbance are too few for a ceiling ({MIN_NULLS} needed)"
        return Feature(name, NOT_TESTED, few)
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
    values = finite(artefacts["zeta_ratio"])
    inside = (1.0 + np.count_nonzero(np.abs(values - SHE_LEVEQUE) <= TOLERANCE)) / (1.0 + len(values))
    return float(inside), float(inside ** len(ensembles.measured))
