"""What drifts, found in a table of medians: trends, drag and what it means, and the second witness."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.archive.profile import ADJOINT
from gliderhpc.platform import Platform
from gliderhpc.studies.drift.change_points import FEWEST_VALUES, Changes
from gliderhpc.studies.drift.drag import DragDrift, coefficient_scale, drag_drift, weight_effects
from gliderhpc.studies.drift.medians import DRAG, PRIMARY, PRIOR, column
from gliderhpc.studies.drift.series import LONGITUDINAL, EstimateTrends, estimate_trends, of_epochs, values_of
from gliderhpc.studies.drift.settings import DriftSettings
from gliderhpc.studies.drift.spread import CoefficientSlopes
from gliderhpc.studies.drift.straightness import is_straight
from gliderhpc.studies.drift.verdict import Verdict
from gliderhpc.studies.drift.witness import Witness, witness_of


@dataclass(frozen=True, eq=False)
class DriftFindings:
    """What is found in a table of medians."""

    trends: list[EstimateTrends]
    drags: list[DragDrift]
    slopes: list[CoefficientSlopes]
    witness: Witness | None
    changes: Changes
    straight: bool

    @property
    def primary(self) -> list[EstimateTrends]:
        """Trends of the primary estimates."""
        return [own for own in self.trends if own.estimate in PRIMARY]

    @property
    def verdict(self) -> Verdict:
        """What the primary estimates say together."""
        drags = tuple(drag for drag in self.drags if drag.estimate in PRIMARY)
        return Verdict(drags, self.changes, self.straight)


def find_drift(
    table: pd.DataFrame,
    hull: Platform,
    settings: DriftSettings,
    slopes: Sequence[CoefficientSlopes] = (),
    changes: Changes | None = None,
) -> DriftFindings:
    """Find trends, drag and their meaning in a table of medians.

    Parameters
    ----------
    table : pandas.DataFrame
        A row a profile: ``profile``, ``elapsed_days``, ``epoch`` and what `profile_row` gives.
    hull : Platform
        The mission's.
    settings : DriftSettings
        How.
    slopes : sequence of CoefficientSlopes
        Over segments of the same profiles, where coefficients were drawn.
    changes : Changes, optional
        Change points of the mission; none by default. Trends of drag are those outside its episodes.
    """
    changes = Changes() if changes is None else changes
    table = of_epochs(table)
    outside = _outside(table, changes)
    estimates = [name for name in (PRIOR, *PRIMARY) if column(DRAG, "dive", name) in table]
    scale = coefficient_scale(slopes, weight_effects(table)) if slopes else (1.0, 1.0)
    return DriftFindings(
        [estimate_trends(table, name, settings.resamples, settings.seed) for name in estimates],
        [drag_drift(table, name, hull, scale, settings.resamples, settings.seed, outside) for name in estimates],
        list(slopes),
        witness_of(table, settings.resamples, settings.seed),
        changes,
        changes.leave_a_line and all(is_straight(table, name, outside) for name in estimates if name in PRIMARY),
    )


def _outside(table: pd.DataFrame, changes: Changes) -> NDArray[np.bool_]:
    """Rows outside the episodes; all of them where these leave fewer than a trend takes."""
    outside = changes.outside(values_of(table, "profile"))
    return outside if outside.sum() >= FEWEST_VALUES else np.ones(len(table), dtype=np.bool_)


def slopes_of_all_samples(found: DriftFindings) -> dict[tuple[str, str], float]:
    """The adjoint's slopes over all samples that count, which the segments stand for, by quantity and phase."""
    trends = next(own for own in found.trends if own.estimate == ADJOINT).trends
    drag = next(own for own in found.drags if own.estimate == ADJOINT).phases
    slopes = {key: one.trend.slope for key, one in trends.items() if key[0] in LONGITUDINAL}
    return slopes | {(DRAG, phase): one.trend.slope for phase, one in drag.items()}
