"""What the catalogue is made from, and what an entry in it does not prove."""

import pandas as pd

from gliderhpc.findings.tables import number
from gliderhpc.report.captions import data_said
from gliderhpc.report.studies.turbulence.captions import series_said
from gliderhpc.report.studies.turbulence.table_3 import unit_of
from gliderhpc.studies.events.settings import EventSettings
from gliderhpc.studies.library.turbulence.ensembles import NullFloor
from gliderhpc.studies.provenance import Provenance


def captions(
    made: Provenance, events: pd.DataFrame, settings: EventSettings, floor: NullFloor | None, ranked_by: str
) -> dict[str, str]:
    """Captions by stem; `ranked_by` says what the threshold is."""
    searched = (
        f"{series_said(made, settings)}, in {data_said(made)}"
        f"{', actuated samples included' if settings.actuated else ', actuated samples left out'}"
    )
    text = (
        f"Peaks of {searched}: {len(events)} above {_threshold(settings, floor, ranked_by)}, of two within "
        f"{settings.separation:g} s the larger."
    )
    doubt = (
        "An event tells a moment on the hull, not its cause: a false sample of the record or an actuator that moves "
        "unrecorded makes one too."
    )
    return {
        # One text serves the figure and its table, which have the same name.
        "events": f"{text} Their places are on the track closed on the fixes. {doubt}",
        "strongest": f"{text} Here the strongest {min(len(events), settings.strongest)}. {doubt}",
        "profiles": f"Noise floor and number of events a profile. {text}",
    }


def _threshold(settings: EventSettings, floor: NullFloor | None, ranked_by: str) -> str:
    unit = unit_of(settings.channel)
    if settings.threshold is not None:
        return f"the {ranked_by}, {number(settings.threshold)} {unit}"
    if floor is None:
        return f"{settings.sigma:g} times each profile's own {ranked_by}, as there are no nulls to rank them by"
    return f"the {ranked_by}, {number(floor.ceiling)} {unit}"
