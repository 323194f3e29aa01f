"""The verdict: the three features that the paper asks for together, each passed, failed or not tested.

It is built to say no. A feature passes only where every profile shows it, a statistic that the records do not give
fails to be tested rather than passing, and one feature that is not passed is enough for the claim not to stand.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from gliderhpc.findings.tables import markdown, number
from gliderhpc.she_leveque import she_leveque
from gliderhpc.studies.library.turbulence.ensembles import Ensembles

SHE_LEVEQUE = she_leveque(6.0)
TOLERANCE = 0.05
"""Distance of an exponent from She and Leveque's that the paper calls turbulence-valued."""

PASSED, FAILED, NOT_TESTED = "passed", "failed", "not tested"

ASSUMPTIONS = (
    "the profiles are independent of each other: the same hull, sensors and settings may bias them alike, which would "
    "make agreement among them no evidence",
    "the exponents of the nulls are a sample of what artefacts give in every one of these profiles; with so few "
    "realisations the share inside the cluster is uncertain, and its power by the number of profiles far more so",
    "the cluster (1.78 within 0.05), the lags of the fit and the band were fixed before the data were seen; what other "
    "lags give stands in the study's table of ranges",
    "it is the chance of one feature under one hypothesis, artefacts of the kinds tested, and not the chance that the "
    "events are turbulence",
    "a passed rank test excludes a Gaussian linear process seen through a fixed distortion, and nothing else: a train "
    "of independent impulses, a sensor's false samples or a variance that changes along the profile may pass it too",
)
"""Of the joint statement."""


@dataclass(frozen=True)
class Feature:
    """One of the paper's three: its name, what came of it, and the figures it came from."""

    name: str
    outcome: str
    figures: str


@dataclass(frozen=True)
class Verdict:
    """The features, and the joint statement.

    Attributes
    ----------
    features : tuple of Feature
        Exponents, amplitudes, rank test.
    inside : float
        Share of the nulls' exponents inside the cluster, with one added to both numbers as is due of so few; NaN
        without nulls.
    joint : float
        Chance that as many profiles drawn from the nulls would all lie in it; NaN without nulls.
    profiles : int
        Profiles with statistics.
    """

    features: tuple[Feature, ...]
    inside: float
    joint: float
    profiles: int

    @property
    def stands(self) -> bool:
        """Whether all features are passed."""
        return all(feature.outcome == PASSED for feature in self.features)

    @property
    def sentence(self) -> str:
        """The verdict in one line."""
        told = ", ".join(f"{feature.name} {feature.outcome}" for feature in self.features)
        conclusion = (
            "the three features of the paper are there" if self.stands else "the claim of turbulence does not stand"
        )
        return f"verdict over {self.profiles} profiles: {conclusion} ({told})"

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "features": [{"name": f.name, "outcome": f.outcome, "figures": f.figures} for f in self.features],
            "stands": self.stands,
            "null_share_inside": self.inside,
            "joint_probability": self.joint,
            "assumptions": list(ASSUMPTIONS),
        }


def verdict(ensembles: Ensembles) -> Verdict:
    """Judge the measured profiles of a mission."""
    inside, joint = _joint(ensembles)
    return Verdict(
        (_exponents(ensembles), _amplitudes(ensembles), _rank_test(ensembles)), inside, joint, len(ensembles.measured)
    )


def verdict_text(found: Verdict) -> str:
    """Lay the verdict out with the assumptions of its joint statement."""
    rows = [(feature.name, feature.outcome, feature.figures) for feature in found.features]
    told = "no nulls, so no joint statement"
    if np.isfinite(found.joint):
        told = (
            f"Share of the nulls' zeta_6 / zeta_3 within {TOLERANCE:g} of {SHE_LEVEQUE:.2f}, one added to both counts: "
            f"{number(found.inside)}. Were the profiles' drawn from the same, all {found.profiles} would lie there "
            f"with the probability {found.joint:.1e}."
        )
    assumed = "\n".join(f"- {text}" for text in ASSUMPTIONS)
    return (
        f"## Verdict\n\n{found.sentence[0].upper()}{found.sentence[1:]}.\n\n"
        + markdown(("feature", "outcome", "figures"), rows)
        + f"\n\n{told}\n\nWhat this takes for granted:\n\n{assumed}\n"
    )


def _exponents(ensembles: Ensembles) -> Feature:
    name = "consistent exponents"
    values = _known(ensembles, "zeta_ratio")
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
    values, ceiling = _known(ensembles, "peak"), ensembles.ceiling
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
    values, level = _known(ensembles, "p_value"), 1.0 / (1 + ensembles.settings.surrogates)
    if not len(values) or len(values) < len(ensembles.measured):
        return Feature(name, NOT_TESTED, f"F({ensembles.settings.lag:g} s) is not resolved in every profile")
    passed = values <= level + 1e-9
    figures = f"{int(passed.sum())} of {len(values)} above all surrogates, p = {number(level)}"
    artefacts = ensembles.artefacts
    if len(artefacts):
        figures += f"; so are {int((artefacts['p_value'] <= level + 1e-9).sum())} of {len(artefacts)} nulls"
    return Feature(name, PASSED if passed.all() else FAILED, figures)


def _joint(ensembles: Ensembles) -> tuple[float, float]:
    artefacts = ensembles.artefacts
    if not len(artefacts) or not len(ensembles.measured):
        return float("nan"), float("nan")
    values = artefacts["zeta_ratio"].to_numpy(dtype=np.float64)
    values = values[np.isfinite(values)]
    inside = (1.0 + np.count_nonzero(np.abs(values - SHE_LEVEQUE) <= TOLERANCE)) / (1.0 + len(values))
    return float(inside), float(inside ** len(ensembles.measured))


def _known(ensembles: Ensembles, name: str) -> Any:
    if ensembles.measured.empty or name not in ensembles.measured:
        return np.empty(0)
    values = ensembles.measured[name].to_numpy(dtype=np.float64)
    return values[np.isfinite(values)]
