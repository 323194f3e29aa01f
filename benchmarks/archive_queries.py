"""Queries of a mission's archive with xarray alone; ``archive`` is its path."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Query:
    """A question and the code that answers it."""

    title: str
    code: str


QUERIES = (
    Query(
        "One profile's series",
        """\
series = xr.open_dataset(archive, engine="zarr", group="series", chunks={})
series = series.sel(profile=68).load().dropna("sample", subset=["B_cr"])
print(series[["B_cu", "B_cr"]].drop_vars(["time", "depth", "profile"]).to_dataframe().describe().round(4))""",
    ),
    Query(
        "One channel over a depth band, all profiles",
        """\
series = xr.open_dataset(archive, engine="zarr", group="series", chunks={"profile": 16})
band = series.B_cu.where((series.depth > 50) & (series.depth < 150))
print(band.mean("sample").compute().to_series().describe().round(5))""",
    ),
    Query(
        "The table of profiles",
        """\
mission = xr.open_dataset(archive, engine="zarr")
table = mission[["status", "start_time", "max_depth", "dac_north", "dac_east"]].to_dataframe()
print(table.tail(5).round(3))""",
    ),
    Query(
        "Samples above a threshold over the mission",
        """\
series = xr.open_dataset(archive, engine="zarr", group="series", chunks={"profile": 16})
beyond = (np.abs(series.B_cr) > 0.5).sum("sample").compute().to_series()
print(beyond.nlargest(5).to_dict(), int(beyond.sum()))""",
    ),
)
