"""Group ``reconstruction`` of an archive, and the names of its columns by quantity, estimator and regime."""

from gliderhpc.store_schema.schema import (
    PROFILE,
    TIME_UNITS,
    Group,
    Variable,
    index_coordinate,
    of_profile,
    profile_coordinate,
)

CHANNEL, ESTIMATOR, IMPULSE = "channel", "estimator", "impulse"
"""Dimensions: the disturbances and the estimators by name, and a profile's true impulses that stand alone."""

TRACKED_UNITS = {"roll": "degree", "pitch": "degree", "heading": "degree", "depth": "m"}


def tracked_column(prefix: str, quantity: str) -> str:
    """Name of a tracked quantity's residual: ``steady_roll``, ``open_loop_adjoint_depth``."""
    return f"{prefix}_{quantity}"


def regime_column(estimator: str, regime: str, statistic: str) -> str:
    """Name of a statistic of the yaw moment: ``yaw_prior_resting_std``."""
    return f"yaw_{estimator}_{regime}_{statistic}"


def truth_column(name: str) -> str:
    """Name of a value by channel and estimator against a truth: ``truth_lag``."""
    return f"truth_{name}"


def impulse_column(name: str) -> str:
    """Name of a value of a true impulse: ``impulse_amplitude``."""
    return f"impulse_{name}"


def _tracked(prefix: str, what: str) -> tuple[Variable, ...]:
    """Return one root mean square a tracked quantity, ``PREFIX_roll`` ... ``PREFIX_depth``."""
    return tuple(
        of_profile(tracked_column(prefix, name), unit, f"{what}, {name}") for name, unit in TRACKED_UNITS.items()
    )


def _regime(estimator: str, regime: str, what: str) -> tuple[Variable, ...]:
    return (
        of_profile(regime_column(estimator, regime, "std"), "N m", f"standard deviation of the {what}"),
        of_profile(
            regime_column(estimator, regime, "peak"), "N m", f"largest magnitude about the median of the {what}"
        ),
        of_profile(regime_column(estimator, regime, "kurtosis"), "1", f"kurtosis (3 for Gaussian) of the {what}"),
        of_profile(regime_column(estimator, regime, "fast"), "1", f"share of the variance above 0.05 Hz of the {what}"),
    )


_LABELS = {"adjoint": "adjoint's", "smoothed": "smoother's", "prior": "filter's"}


def _of_impulse(name: str, units: str, long_name: str, *dims: str) -> Variable:
    return Variable(impulse_column(name), (PROFILE, IMPULSE, *dims), "float64", units, long_name, whole=True)


def _against_truth() -> tuple[Variable, ...]:
    """Return what a synthetic mission's truth tells of both estimators; missing where none was given."""
    by_channel = {
        "lag": ("s", "delay behind the truth"),
        "correlation": ("1", "correlation with the truth at that delay"),
        "gain": ("1", "slope on the truth at that delay, 1 where nothing is attenuated"),
    }
    return (
        Variable(CHANNEL, (CHANNEL,), "string", "1", "name of the disturbance"),
        Variable(ESTIMATOR, (ESTIMATOR,), "string", "1", "the estimate that was studied, and the filter's"),
        index_coordinate(IMPULSE, "number of the impulse within its profile, from 0"),
        index_coordinate("sample", "integration step from the first observation"),
        *(Variable(truth_column(name), (PROFILE, CHANNEL, ESTIMATOR), "float64", units, long_name, whole=True)
          for name, (units, long_name) in by_channel.items()),
        _of_impulse("time", "s", "true time of a yaw impulse since the profile's first sample"),
        _of_impulse("amplitude", "N m", "its true height"),
        _of_impulse("width", "s", "its true width"),
        _of_impulse("delay", "s", "delay of the peak that the estimator shows", ESTIMATOR),
        _of_impulse("ratio", "1", "height of that peak over the true one", ESTIMATOR),
        Variable("B_cr_truth", (PROFILE, "sample"), "float32", "N m", "true yaw moment, averaged over the samples"),
    )  # fmt: skip


def reconstruction_group() -> Group:
    """Declare group ``reconstruction``."""
    return Group(
        "reconstruction",
        "how the estimated motion follows the records (section 5.1.1, Table 2 and Figure 3 of the paper)",
        (
            profile_coordinate(),
            of_profile("message", "1", "what to mind about the profile's row", dtype="string"),
            *_tracked("steady", "residual of the reconstruction over steady glide"),
            *_tracked("vibration", "residual of the reconstruction over the vibration intervals"),
            of_profile("segment_start", TIME_UNITS, "start of the steady segment of the open-loop runs", "time"),
            *_tracked("open_loop_adjoint", "open-loop residual under the adjoint's disturbance"),
            *_tracked("open_loop_smoothed", "open-loop residual under the smoother's disturbance"),
            *_tracked("open_loop_prior", "open-loop residual under the filter's disturbance"),
            *_tracked("no_slope_steady", "residual over steady glide of the inversion with k_z = 0"),
            *_tracked("no_slope_vibration", "residual over the vibration intervals of the inversion with k_z = 0"),
            of_profile("no_slope_heave_slope", "N m-1", "slope of B_cw with depth under k_z = 0, less that under k_z"),
            of_profile("no_slope_self_motion", "1", "change of the self-motion by k_z = 0, relative"),
            of_profile("vibration_fraction", "1", "part of the time inside the vibration set"),
            of_profile("vibration_speed", "m s-1", "displacement within the vibration set over the profile's duration"),
            of_profile("vibration_share", "1", "vibration_speed over the depth-averaged current"),
            of_profile("self_motion_spread", "1", "difference of estimated and glide-angle displacement, relative"),
            of_profile("self_motion_speed_spread", "1", "root mean square difference of estimated and glide-angle "
                       "horizontal speed over steady glide, over that of the glide-angle speed"),
            of_profile("iterations_median", "1", "median of the windows' iterations"),
            of_profile("iterations_spread", "1", "interquartile range of the windows' iterations"),
            of_profile("iterations_most", "1", "largest number of iterations of a window"),
            of_profile("window_seconds", "s", "computing time of the profile over its number of windows"),
            of_profile("profile_seconds", "s", "computing time of the profile"),
            of_profile("filter_seconds", "s", "computing time of the filter alone"),
            *(variable
              for estimator, label in _LABELS.items()
              for regime, when in (("resting", "battery not rotated"), ("rotated", "battery rotated"))
              for variable in _regime(estimator, regime, f"{label} yaw moment in steady glide, {when}")),
            of_profile("rotated_fraction", "1", "part of the steady glide with the battery rotated"),
            of_profile("yaw_correlation", "1", "correlation of the two yaw moments at the lag that raises it most"),
            of_profile("yaw_lag", "s", "that lag: the filter behind the estimate"),
            *_against_truth(),
        ),
    )  # fmt: skip
