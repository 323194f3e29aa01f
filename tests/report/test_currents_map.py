"""Map of depth-averaged currents: arrows and ellipses to scale, and refused input."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import PolyCollection
from matplotlib.quiver import Quiver
from support.glides import Glide, mission

import gliderhpc as gh


@pytest.fixture(scope="module")
def found():
    return gh.currents(mission(Glide()))


def drawn(figure, kind):
    return [one for one in figure.axes[0].collections if isinstance(one, kind)]


def test_arrows_point_along_the_currents(found):
    figure = gh.plot_currents(found)
    figure.draw_without_rendering()
    arrows, key = drawn(figure, Quiver)
    known = np.isfinite(found["dac_north"].values)
    assert known.sum() == len(arrows.U) > 0
    narrowing = np.cos(np.radians(arrows.XY[:, 1].mean()))
    east, north = np.asarray(arrows.U) * narrowing, np.asarray(arrows.V)
    assert np.arctan2(east, north) == pytest.approx(
        np.arctan2(found["dac_east"].values[known], found["dac_north"].values[known])
    )
    length = float(key.U[0]) * narrowing
    speed = float(figure.axes[0].texts[0].get_text().removesuffix(" m/s"))
    assert np.hypot(east, north) / length * speed == pytest.approx(
        np.hypot(found["dac_east"].values, found["dac_north"].values)[known]
    )
    assert f"{known.sum()} dive" in figure.axes[0].get_title(loc="left")


def test_ellipses_are_one_standard_deviation(found):
    changed = found.assign(dac_covariance=0.5 * found["dac_north_std"] * found["dac_east_std"])
    figure = gh.plot_currents(changed)
    arrows, key = drawn(figure, Quiver)
    narrowing = np.cos(np.radians(arrows.XY[:, 1].mean()))
    speed = float(figure.axes[0].texts[0].get_text().removesuffix(" m/s"))
    unit = float(key.U[0]) * narrowing / speed
    outline = drawn(figure, PolyCollection)[0].get_paths()[0].vertices
    known = int(np.flatnonzero(np.isfinite(found["dac_north"].values))[0])
    widths = np.ptp(outline, axis=0) / 2.0 * [narrowing, 1.0] / unit
    row = changed.isel(profile=known)
    assert widths == pytest.approx([float(row["dac_east_std"]), float(row["dac_north_std"])], rel=5e-3)


@pytest.mark.compiled
def test_an_archive_s_currents_are_drawn(brief_store):
    assert len(drawn(gh.plot_currents(gh.open_mission(brief_store)), Quiver)[0].U) == 3


def test_without_a_current_there_is_nothing_to_draw(found):
    with pytest.raises(gh.InputError, match="no profile has a current"):
        gh.plot_currents(found.assign(dac_north=found["dac_north"] * np.nan))
    with pytest.raises(gh.InputError, match="no profile has a current"):
        gh.plot_currents(xr.Dataset())
