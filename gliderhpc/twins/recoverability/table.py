"""The figures of ``twin recoverability`` beside those of sections 5.1.1, 5.3 and 5.5."""

from gliderhpc.findings.comparison import Comparison
from gliderhpc.twins.recoverability.results import RecoverabilityResults
from gliderhpc.twins.recoverability.runs import MODELS


def compare_recoverability(results: RecoverabilityResults, preset: str) -> list[Comparison]:
    """Lay the paper's figures of sections 5.1.1, 5.3 and 5.5 beside ours, for one preset."""
    noise = results.noise[preset]
    exact, wrong = (
        next(row for row in results.errors if row["preset"] == preset and row["model"] == model) for model in MODELS
    )
    floors = [row for row in results.floors if row["preset"] == preset]
    return [
        Comparison("identification noise, RMS", "N m", noise["noise"], (0.4, 0.7),
                   remark="the paper's own Table 3 has at most 0.24 as the largest"),
        Comparison("identification noise, largest", "N m", noise["largest"], 0.24, paper_said="<= 0.24"),
        Comparison("threshold: one false alarm an hour", "N m", noise["threshold"],
                   remark=f"{noise['threshold_multiples']:.1f} times the noise; {noise['hours']:.1f} h of noise alone"),
        *(
            Comparison(f"floor, impulse of {row['width']:g} s", "N m", row["floor"], remark="found nine times in ten")
            for row in floors
        ),
        *(
            Comparison(f"floor over noise, impulse of {row['width']:g} s", "1", row["multiples"], (25.0, 40.0))
            for row in floors
        ),
        Comparison("axial offset, exact coefficients", "N", 0.5 * (exact["axial_dive"] + exact["axial_climb"]), -0.5,
                   (exact["axial_least"], exact["axial_most"]), remark="spread: least and most of dive or climb"),
        Comparison("axial offset, coefficients within 15%", "N", 0.5 * (wrong["axial_dive"] + wrong["axial_climb"]),
                   (-0.75, -0.4), (wrong["axial_least"], wrong["axial_most"]), remark="spread as above"),
        Comparison("velocity error, exact coefficients", "m/s", exact["velocity_error"], (0.05, 0.06)),
        Comparison("velocity error, coefficients within 15%", "m/s", wrong["velocity_error"]),
        Comparison("budget: axial error", "m/s", wrong["axial_error"], (0.05, 0.06), remark="coefficients within 15%"),
        Comparison("budget: relative error", "1", wrong["relative_error"], 0.26, remark="coefficients within 15%"),
        Comparison("budget: heading error", "degree", wrong["heading_error"], 8.0, remark="coefficients within 15%"),
        Comparison("median squared distance under the budget", "1", wrong["median_distance"],
                   remark="1.39 if the ellipses fit"),
    ]  # fmt: skip
