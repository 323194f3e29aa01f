"""Group ``reanalysis`` of an archive."""

from gliderhpc.store_schema.schema import PROFILE, TIME_UNITS, Group, Variable, of_profile, profile_coordinate

MODEL = "model"
"""Dimension of the ocean models that study `reanalysis` was given, by name."""


def _of_model(name: str, units: str, long_name: str, standard_name: str | None = None) -> Variable:
    return Variable(name, (PROFILE, MODEL), "float64", units, long_name, standard_name, whole=True)


def reanalysis_group() -> Group:
    """Declare group ``reanalysis``."""
    return Group(
        "reanalysis",
        "the depth-averaged current beside ocean models (section 5.5, Table 4 and Figure 8 of the paper)",
        (
            profile_coordinate(),
            Variable(MODEL, (MODEL,), "string", "1", "name of the ocean model"),
            of_profile("message", "1", "why the profile is not held against a model", dtype="string"),
            of_profile("time", TIME_UNITS, "time of the middle of the dive", "time"),
            of_profile("latitude", "degrees_north", "latitude of the middle of the dive", "latitude"),
            of_profile("longitude", "degrees_east", "longitude of the middle of the dive", "longitude"),
            of_profile("records", "1", "number of records, evenly spaced in time, at which models are sampled"),
            _of_model("north", "m s-1", "the model's current to the north, mean over the records of the dive",
                      "northward_sea_water_velocity"),
            _of_model("east", "m s-1", "the model's current to the east, mean over the records of the dive",
                      "eastward_sea_water_velocity"),
            _of_model("covered_fraction", "1", "part of the records for which the model has a velocity"),
            _of_model("outside_box", "1", "number of records outside the model's latitudes or longitudes"),
            _of_model("outside_time", "1", "number of those left that lie outside its times"),
            _of_model("outside_depth", "1", "number of those left that lie above or below its depths"),
            _of_model("on_land", "1", "number of those left that have land or bottom next to them"),
            _of_model("vector_difference", "m s-1", "length of the model's current less the glider's"),
            _of_model("speed_difference", "m s-1", "the model's speed less the glider's"),
            _of_model("direction_difference", "degree", "the model's direction less the glider's, clockwise positive"),
            _of_model("distance", "1", "Mahalanobis distance of the model from the glider's current by its covariance: "
                      "standard deviations"),
        ),
    )  # fmt: skip
