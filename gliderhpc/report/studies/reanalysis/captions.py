"""What the tables and the figure beside ocean models are made from, and what they do not settle."""

import numpy as np

from gliderhpc.report.captions import data_said, estimate_said, profiles_said
from gliderhpc.studies.provenance import Provenance
from gliderhpc.studies.reanalysis.beside_models import LEAST_COVERED
from gliderhpc.studies.reanalysis.compared import Compared

_DOUBT = (
    "A distance counts the glider's own uncertainty alone: what a model leaves out, or its grid smooths, is in the "
    "difference and not in the distance's scale."
)


def captions(made: Provenance, compared: Compared, places: list[int], *, by_study: bool) -> dict[str, str]:
    """Captions by stem; `places` are those of Table 4 and Figure 8."""
    data, models = data_said(made), ", ".join(compared.names)
    covered = int(np.isfinite(compared.models.sum(axis=2)).any(axis=1).sum())
    panels = profiles_said([int(compared.numbers[place]) for place in places])
    ellipse = "of study currents" if by_study else "of the mission's run"
    glider = f"depth-averaged current by {estimate_said(made)}"
    return {
        "figure_8": (
            f"The {glider} with its 1- and 2-sigma ellipses ({ellipse}), that by the glide angle, and those of "
            f"{models} averaged over the same dive in time and depth: {panels}. {_DOUBT}"
        ),
        "table_4": (
            f"Speed and direction of every current, and each model's distance in sigma of the {glider} ({ellipse}): "
            f"{panels}. {_DOUBT}"
        ),
        "agreement": (
            f"How currents differ over the mission, and the share of profiles on which a model lies within 1, 2 and 3 "
            f"sigma: {data}, {covered} of them covered by a model. {_DOUBT}"
        ),
        "profiles": (
            f"A row a profile and model of {models}, sampled along the dive: {data}. A model that covers less than "
            f"{LEAST_COVERED:.0%} of the dive's time has no value, and why is counted. {_DOUBT}"
        ),
    }
