"""Variables of an OG1 file as data: name, number type and attributes.

OG1 1.0 prescribes the coordinates, the fixes and the platform's metadata; its vocabulary (NERC collection OG1) has
names for attitude. The names of controls, currents and speeds are those of Seaglider files in OG1, with the same units
and signs, since diagnostic programs use them. Estimates of this program have the archive's names in capitals, followed
by the estimator: ``B_CU_ADJOINT``, ``B_CU_SMOOTHED``, ``B_CU_SMOOTHED_STD``.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from gliderhpc.archive.profile import TRACKED
from gliderhpc.store_schema import MISSION
from gliderhpc.store_schema.schema import MOTION
from gliderhpc.vocabulary import CHANNELS, QUALITY

AXIS = "N_MEASUREMENTS"

_TERM = "http://vocab.nerc.ac.uk/collection/OG1/current/{}/"
"""Identifier of a term. The server's identifiers begin with http, and checkers compare the text."""
_PHASES = "https://github.com/OceanGlidersCommunity/OG-format-user-manual/blob/main/vocabularyCollection/phase.md"
TIME_ATTRIBUTES = {
    "calendar": "gregorian",
    "units": "seconds since 1970-01-01T00:00:00Z",
    "valid_min": 1e9,
    "valid_max": 4e9,
}
LATITUDE_ATTRIBUTES = {"standard_name": "latitude", "units": "degrees_north", "valid_min": -90.0, "valid_max": 90.0}
LONGITUDE_ATTRIBUTES = {"standard_name": "longitude", "units": "degrees_east", "valid_min": -180.0, "valid_max": 180.0}
_NO_PLACE, _NO_TIME = -9999.9, -1.0
_AT = "TIME LONGITUDE LATITUDE DEPTH"

RECKONING = (
    "dead reckoning: the sum of the fix before the dive, the drift at the surface (which is not part of the current), "
    "the displacement through the water by the estimated motion (vibration intervals bridged), and the displacement "
    "by each dive-climb cycle's current, so that the track ends on the fix after the dive; POSITION_METHOD states "
    "where one of the two fixes is missing"
)
"""Method of the positions below the surface."""

PHASES = {"unknown": 0, "ascent": 1, "descent": 2, "surfacing": 3}
"""Values of PHASE (OG1 phase vocabulary)."""

CURRENT_ESTIMATES = {"none": 0, "adjoint": 1, "smoothed": 2}
"""Values of DAVG_CURR_ESTIMATE."""

POSITION_METHODS = {"none": 0, "gps_fix": 1, "between_both_fixes": 2, "from_the_fix_before": 3, "to_the_fix_after": 4}
"""Values of POSITION_METHOD."""

SAMPLED = {"interpolated": 0, "sampled": 1}
"""Values of SAMPLED."""

QC_FLAGS = ("no_qc_applied", "good_data", "probably_good_data", "probably_bad_data", "bad_data")


@dataclass(frozen=True)
class Og1Term:
    """One variable along the axis of measurements.

    Attributes
    ----------
    name : str
        Name in the file.
    dtype : str
        Number type.
    attributes : mapping
        Attributes of the variable.
    fill : float, optional
        Fill value; NaN for floating-point numbers by default.
    """

    name: str
    dtype: str
    attributes: Mapping[str, Any]
    fill: float | None = None


def _coordinates() -> Iterator[Og1Term]:
    yield Og1Term(
        "TIME",
        "f8",
        {
            "long_name": "time of measurement or GPS location",
            "standard_name": "time",
            **TIME_ATTRIBUTES,
            "interpolation_methodology": "records on the archive's output interval",
            "time_vocabulary": _TERM.format("TIME"),
        },
        _NO_TIME,
    )
    yield Og1Term(
        "LATITUDE",
        "f8",
        {
            "long_name": "latitude of each measurement and GPS location",
            **LATITUDE_ATTRIBUTES,
            "interpolation_methodology": RECKONING,
            "latitude_vocabulary": _TERM.format("LAT"),
        },
        _NO_PLACE,
    )
    yield Og1Term(
        "LONGITUDE",
        "f8",
        {
            "long_name": "longitude of each measurement and GPS location",
            **LONGITUDE_ATTRIBUTES,
            "interpolation_methodology": RECKONING,
            "longitude_vocabulary": _TERM.format("LON"),
        },
        _NO_PLACE,
    )
    yield Og1Term(
        "DEPTH",
        "f8",
        {
            "long_name": "depth below the surface",
            "standard_name": "depth",
            "units": "m",
            "positive": "down",
            "valid_min": -10.0,
            "valid_max": 11000.0,
            "interpolation_methodology": "measured depth, linear between its samples; missing in gaps of the record, "
            "zero where a fix was taken",
            "depth_vocabulary": _TERM.format("DEPTH"),
        },
        _NO_PLACE,
    )
    yield Og1Term("TIME_GPS", "f8", {"long_name": "time of each GPS location", **TIME_ATTRIBUTES}, _NO_TIME)
    yield Og1Term(
        "LATITUDE_GPS", "f8", {"long_name": "latitude of each GPS location", **LATITUDE_ATTRIBUTES}, _NO_PLACE
    )
    yield Og1Term(
        "LONGITUDE_GPS", "f8", {"long_name": "longitude of each GPS location", **LONGITUDE_ATTRIBUTES}, _NO_PLACE
    )


def flags(name: str, long_name: str, kind: str, meanings: Mapping[str, int], dtype: str = "i1", **more: str) -> Og1Term:
    """Return the term of a flag variable; `kind` is ``flag_values`` or ``flag_masks``."""
    values: list[Any] = list(meanings.values())
    return Og1Term(
        name, dtype, {"long_name": long_name, kind: values, "flag_meanings": " ".join(meanings), "units": "1", **more}
    )


def _count_terms() -> Iterator[Og1Term]:
    yield Og1Term("DIVE_NUMBER", "i4", {"long_name": "number of the profile in the archive", "units": "1"})
    yield Og1Term(
        "PROFILE_NUMBER",
        "i4",
        {
            "long_name": "descents and ascents, numbered consecutively",
            "units": "1",
            "comment": "a row of a fix has the number of the descent after it or of the ascent before it",
        },
    )
    yield flags(
        "PHASE",
        "behavior of the glider at sea",
        "flag_values",
        PHASES,
        phase_vocabulary=_PHASES,
        phase_calculation_method="each dive-climb cycle descends to its deepest record and ascends from there; rows of "
        "a fix are at the surface",
    )
    yield flags("POSITION_METHOD", "where latitude and longitude come from", "flag_values", POSITION_METHODS)
    yield flags(
        "SAMPLED",
        "whether depth and attitude were sampled here, or are interpolated between samples",
        "flag_values",
        SAMPLED,
    )
    yield flags("QUALITY", "flags of the estimate, from any step of the record", "flag_masks", QUALITY.meanings, "u1")


_BETWEEN_SAMPLES = "linear between samples where SAMPLED is zero; missing in gaps of the record"


def _measured_terms() -> Iterator[Og1Term]:
    described = {
        "ROLL": ("roll, starboard down", "platform_roll_starboard_down"),
        "PITCH": ("pitch, nose up", "platform_pitch_fore_up"),
        "HEADING": ("heading, clockwise from true north", "platform_orientation"),
    }
    for name, (long_name, standard_name) in described.items():
        yield quantity(
            name,
            "degree",
            long_name,
            standard_name=standard_name,
            observation_type="measured",
            interpolation_methodology=_BETWEEN_SAMPLES,
        )
    yield quantity("PITCH_CTL", "cm", "position of the moving battery", comment="grows aft: minus battery_position")
    yield quantity("ROLL_CTL", "degree", "rotation of the moving battery", comment="positive with starboard down")
    yield quantity("VBD_CC", "cm3", "oil in the external bladder", comment="positive buoyant")
    yield quantity("RUDDER", "degree", "rudder angle", comment="positive where it turns the glider to starboard")


def _current_terms() -> Iterator[Og1Term]:
    origins = {
        "": "the estimate that DAVG_CURR_ESTIMATE names",
        "_ADJOINT": "the adjoint's displacement",
        "_SMOOTHED": "the smoother's displacement",
    }
    for suffix, origin in origins.items():
        for along, towards in (("NORTH", "north"), ("EAST", "east")):
            yield quantity(
                f"DAVG_CURR_{along}{suffix}",
                "m s-1",
                f"depth-averaged current to the {towards}, by {origin}",
                standard_name=f"{towards}ward_sea_water_velocity",
                observation_type="calculated",
                comment="one value per dive, on all of its rows",
            )
            yield quantity(
                f"DAVG_CURR_{along}{suffix}_STD",
                "m s-1",
                f"standard deviation of DAVG_CURR_{along}{suffix}",
                standard_name=f"{towards}ward_sea_water_velocity standard_error",
            )
    yield flags(
        "DAVG_CURR_ESTIMATE",
        "method that gave DAVG_CURR_NORTH and DAVG_CURR_EAST",
        "flag_values",
        CURRENT_ESTIMATES,
        comment="the smoother's displacement through the water where it is usable, else the adjoint's",
    )


_STANDARD_NAMES = {
    "ROLL": "platform_roll_starboard_down",
    "PITCH": "platform_pitch_fore_up",
    "HEADING": "platform_orientation",
    "P": "platform_roll_rate_starboard_down",
    "Q": "platform_pitch_rate_fore_up",
    "R": "platform_yaw_rate_fore_starboard",
}
"""CF standard names of estimated quantities; forces, moments and displacements through the water have none."""


def _estimates(estimator: str) -> Iterator[Og1Term]:
    for name, (units, long_name) in {**CHANNELS, **MOTION}.items():
        over = ", mean over the record's interval" if name in CHANNELS and estimator == "ADJOINT" else ""
        yield _estimate(name, estimator, units, f"{long_name}, {estimator.lower()} estimate{over}")
    for name in TRACKED:
        variable = MISSION["state"][name]
        long_name = variable.long_name.replace("reconstructed ", "")
        yield _estimate(name, estimator, variable.units, f"{long_name}, {estimator.lower()} estimate")


def _estimate(name: str, estimator: str, units: str, long_name: str) -> Og1Term:
    standard = _STANDARD_NAMES.get(name.upper())
    more = {} if standard is None else {"standard_name": standard}
    return quantity(f"{name.upper()}_{estimator}", units, long_name, **more)


def quantity(name: str, units: str, long_name: str, **more: str) -> Og1Term:
    """Return the term of a quantity at the times and positions of the rows."""
    return Og1Term(name, "f4", {"long_name": long_name, "units": units, "coordinates": _AT, **more})


_SPEEDS = (
    quantity(
        "GLIDE_SPEED",
        "m s-1",
        "speed through the water, adjoint estimate",
        standard_name="platform_speed_wrt_sea_water",
        observation_type="calculated",
        comment="of the motion under the estimated disturbance, not of the hull's undisturbed flight model",
    ),
    quantity(
        "GLIDER_HORZ_VELO_MODEL",
        "m s-1",
        "horizontal part of GLIDE_SPEED",
        observation_type="calculated",
        comment="as GLIDE_SPEED",
    ),
    quantity(
        "ANGLE_OF_ATTACK",
        "degree",
        "angle of attack, adjoint estimate",
        observation_type="calculated",
        comment="atan2(W_ADJOINT, U_ADJOINT): positive where the water meets the hull from below, as on descents; of "
        "the motion under the estimated disturbance",
    ),
)

_WATER = "VERT_CURR_MODEL"

VERTICAL_TERMS = (
    quantity("GLIDER_VERT_VELO_DZDT", "m s-1", "vertical velocity of the glider by its depth, upward, filtered",
           observation_type="calculated", comment="study vertical of the archive; NaN between samples"),
    quantity("GLIDER_VERT_VELO_MODEL", "m s-1", "vertical velocity of the hull's glide in still water, upward",
           observation_type="calculated",
           comment="steady glide at the measured pitch and ballast, filtered as GLIDER_VERT_VELO_DZDT; not the motion "
           "under the estimated disturbance"),
    quantity(_WATER, "m s-1", "vertical velocity of the water, upward", standard_name="upward_sea_water_velocity",
           observation_type="calculated", comment="GLIDER_VERT_VELO_DZDT minus GLIDER_VERT_VELO_MODEL"),
    quantity(f"{_WATER}_STD", "m s-1",
             f"standard deviation of {_WATER}: noise, rounded pitch and the hull's parameters"),
)  # fmt: skip
"""Terms that are written only if study ``vertical`` has been run."""

WITH_QC = ("TIME", "LATITUDE", "LONGITUDE", "DEPTH", "TIME_GPS", "LATITUDE_GPS", "LONGITUDE_GPS", "PHASE")
"""Variables with a quality-control flag, whose value is always that no quality control was applied."""


def quality_control(name: str, **more: str) -> Og1Term:
    """Return the term of a variable's quality-control flag."""
    meanings = {meaning: value for value, meaning in enumerate(QC_FLAGS)}
    return flags(f"{name}_QC", "quality flag", "flag_values", meanings, **more)


MAX_DIFFERENCE = 2.0
"""Largest difference of dives and climbs, in standard deviations, for a probably good velocity of the water."""

VERTICAL_QC = quality_control(
    _WATER,
    comment="one test per dive: probably good where the mean vertical velocities of the water on descent and ascent "
    f"differ by at most {MAX_DIFFERENCE:g} standard deviations of the difference, probably bad where they differ "
    "by more; no test where they cannot be compared",
)


def deviation_of(term: Og1Term) -> Og1Term:
    """Return the term of an estimate's standard deviation."""
    attributes = {
        "long_name": f"standard deviation of {term.name}",
        "units": term.attributes["units"],
        "coordinates": _AT,
    }
    if "standard_name" in term.attributes:
        attributes["standard_name"] = f"{term.attributes['standard_name']} standard_error"
    return Og1Term(f"{term.name}_STD", term.dtype, attributes)


ADJOINT_TERMS = tuple(_estimates("ADJOINT"))
SMOOTHED_TERMS = tuple(_estimates("SMOOTHED"))

TERMS: Mapping[str, Og1Term] = {
    term.name: term
    for term in (
        *_coordinates(), *_count_terms(), *_measured_terms(), *_current_terms(), *_SPEEDS, *VERTICAL_TERMS, VERTICAL_QC,
        *ADJOINT_TERMS, *SMOOTHED_TERMS,
        *map(deviation_of, (*ADJOINT_TERMS[: len(CHANNELS)], *SMOOTHED_TERMS)), *map(quality_control, WITH_QC),
    )
}  # fmt: skip
"""Variables along the axis of measurements, by name."""

MEASURED_TERMS = frozenset(term.name for term in _measured_terms())
"""Names of the variables measured by the glider."""

SINGLE: Mapping[str, Mapping[str, Any]] = {
    "TRAJECTORY": {"long_name": "trajectory name", "cf_role": "trajectory_id"},
    "WMO_IDENTIFIER": {"long_name": "wmo id"},
    "PLATFORM_MODEL": {"long_name": "model of the glider"},
    "PLATFORM_SERIAL_NUMBER": {"long_name": "glider serial number"},
    "PLATFORM_NAME": {"long_name": "local or nickname of the glider"},
    "PLATFORM_MAKER": {"long_name": "glider manufacturer"},
    "DEPLOYMENT_TIME": {
        "long_name": "date of deployment",
        "standard_name": "time",
        "calendar": "gregorian",
        "units": TIME_ATTRIBUTES["units"],
    },
    "DEPLOYMENT_LATITUDE": {"long_name": "latitude of deployment", **LATITUDE_ATTRIBUTES},
    "DEPLOYMENT_LONGITUDE": {"long_name": "longitude of deployment", **LONGITUDE_ATTRIBUTES},
}
"""Attributes of the single-valued variables, by name."""

REQUIRED = (
    "contributor_name",
    "contributor_email",
    "contributor_role",
    "contributor_role_vocabulary",
    "contributing_institutions",
    "contributing_institutions_role",
    "contributing_institutions_role_vocabulary",
)
"""Global attributes required by OG1 that only the user can supply."""
