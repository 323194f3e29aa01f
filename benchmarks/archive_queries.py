"""The queries that users put to a mission's archive, by xarray alone; ``archive`` is its path."""

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
tree = xr.open_datatree(archive, engine="zarr", chunks={})
series = tree["series"].ds.sel(profile=68).dropna("sample", subset=["B_cr"]).load()
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
tree = xr.open_datatree(archive, engine="zarr")
table = tree.ds[["status", "start_time", "max_depth", "dac_north", "dac_east"]].to_dataframe()
print(table.tail(5).round(3))""",
    ),
    Query(
        "Events above a threshold over the mission",
        """\
tree = xr.open_datatree(archive, engine="zarr", chunks={})
moment = np.abs(tree["series"].ds.B_cr.variable.data)
beyond = (moment > 0.5).sum(axis=1).compute()
counts = dict(zip(tree["series"].ds.profile.values, beyond))
most = sorted(counts, key=counts.get, reverse=True)[:5]
print({int(number): int(counts[number]) for number in most}, int(beyond.sum()))""",
    ),
)
