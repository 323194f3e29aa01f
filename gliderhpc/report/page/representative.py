"""One profile for all: measured and reconstructed motion, and the disturbances by every estimator."""

from pathlib import Path

import numpy as np
import xarray as xr

from gliderhpc.archive.profile import done_profiles
from gliderhpc.observations.truth import read_profile_truth
from gliderhpc.report.page.content import Commands, Picture, Section, Words
from gliderhpc.report.profile_figure import profile_figure

_CAPTION = (
    "Top: attitude and depth as measured and as the model gives them under the adjoint's disturbances; the residual "
    "is that of steady glide. Below: the three forces and three moments that the water exerted beyond the hull's own "
    "coefficients, by the adjoint (windows, the method of record), by the extended Kalman filter that it starts from "
    "and, with a band of one standard deviation either way, by the smoother. The band holds what prior and sensors "
    "leave open, not errors of the hull's coefficients; axial and heave force are only weakly observed. Grey: "
    "actuators moving."
)


_WITH_TRUTH = " Dashed: the truth of this synthetic mission, and the errors against it in steady glide."


def representative_section(archive: xr.DataTree, command: str, truth: Path | None) -> Section | None:
    """The profile of median depth among those that are done, None without any; `truth` is a synthetic mission's."""
    number = representative_profile(archive)
    if number is None:
        return None
    how = Words(
        f"Profile {number}, the one of median depth among those that are done, stands for all (the publication's "
        "Figures 2 and 3 show such profiles)."
    )
    figure = motion_picture(archive, number, "representative_profile", truth)
    other = Commands("Any profile, with its windows, controls and currents, has a page of its own by:", (command,))
    return Section("representative", f"A representative profile: {number}", (how, figure, other))


def motion_picture(archive: xr.DataTree, number: int, stem: str, truth: Path | None) -> Picture:
    """A profile's motion and disturbances, beside their truth where that is known."""
    known = None if truth is None else read_profile_truth(truth, number)
    return Picture(
        stem, f"Profile {number}. {_CAPTION}{'' if truth is None else _WITH_TRUTH}", _alternative(number),
        profile_figure(archive, number, known),
    )  # fmt: skip


def representative_profile(archive: xr.DataTree) -> int | None:
    """Number of the profile of (lower) median depth among those that are done."""
    done = done_profiles(archive)
    if not done:
        return None
    depth = archive.to_dataset()["max_depth"].sel(profile=done).values
    return done[int(np.argsort(depth, kind="stable")[(len(done) - 1) // 2])]


def _alternative(number: int) -> str:
    """Text in place of the figure."""
    return (
        f"Ten panels over the time of profile {number}: roll, pitch, heading and depth, measured and reconstructed; "
        "then the forces along and the moments about the three axes, by adjoint, filter and smoother."
    )
