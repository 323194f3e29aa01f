"""Disturbance priors of filter and smoother: the platform file's, or usual ones for its sensors and records."""

from gliderhpc.platform import DisturbancePrior, Platform

SLOW_SENSORS_PRIOR = 2.0
"""Sample interval (s) beyond which a platform file without a prior gets the prior of slow sensors."""
_SLOW_RATIO = 1.25
"""A record counts as slow if its interval exceeds `SLOW_SENSORS_PRIOR` by this factor; a 2 s record with jitter does
not."""


ROUGH_WATER = DisturbancePrior(
    deviation=(0.4, 1.0, 0.4, 0.3, 0.15, 1.0), correlation_time=(3600.0, 10.0, 3600.0, 10.0, 3600.0, 60.0)
)
"""Prior in which sway and roll follow gusts within seconds, tried if the calmer one does not fit the record."""


_GUST_FORCE, _GUST_TIME = 2.0, 1.0
"""Standard deviation (N) and correlation time (s) of the side force in gusts of a few centimetres per second."""


def with_lateral_gusts(prior: DisturbancePrior) -> DisturbancePrior:
    """Return a prior, usual or tuned, in which the side force follows gusts from the side within seconds."""
    return DisturbancePrior(
        deviation=(prior.deviation[0], max(_GUST_FORCE, prior.deviation[1]), *prior.deviation[2:]),
        correlation_time=(
            prior.correlation_time[0],
            min(_GUST_TIME, prior.correlation_time[1]),
            *prior.correlation_time[2:],
        ),
    )


USUAL_WEIGHT, _LEAST_WEIGHT = 1.5, 0.15
"""Weights in water (N) that drive a glider: from the first on, the usual priors are meant, and most gliders fly with
more; with less than the second none glides, and the record of the ballast does not show the drive."""


def for_weight(prior: DisturbancePrior, weight: float) -> DisturbancePrior:
    """Return a usual prior with the forces reduced for a glider with a small net weight in water, N.

    Errors of drag and lift, and forces due to shear, are fractions of the hydrodynamic forces, which together balance
    the net weight. With forces of the usual size, the speed of a glider with a net weight of 0.5 N would appear twice
    as large as it is. The prior is returned unchanged if the net weight is not known, as without a record of the
    ballast.
    """
    factor = min(1.0, weight / USUAL_WEIGHT) if weight >= _LEAST_WEIGHT else 1.0
    forces = [factor * deviation for deviation in prior.deviation[:3]]
    return DisturbancePrior(deviation=(*forces, *prior.deviation[3:]), correlation_time=prior.correlation_time)


def candidate_priors(
    platform: Platform, interval: float = 0.0, weight: float = USUAL_WEIGHT
) -> dict[str, DisturbancePrior]:
    """Priors to try in turn, by the archive's name for them (`DISTURBANCE_PRIOR`).

    Parameters
    ----------
    platform, interval : Platform, float
        Parameters of `default_prior`.
    weight : float
        Weight in water that drives the glider, N (`for_weight`).

    Notes
    -----
    They are the platform's own prior alone, or `default_prior` and a freer one. The calmer prior is better wherever it
    can follow the record (docs/accuracy.md). In gusts it cannot, and the filter rejects samples
    (docs/scenario-current.md) or finds innovations far larger than it expects. For fast sensors the freer prior is
    `ROUGH_WATER`. For slow ones it is the usual one with only the yawing moment of `SLOW_RECORD`, since their buoyancy
    and trim are free already.
    """
    usual = default_prior(platform, interval)
    if platform.prior is not None:
        return {"usual": usual}
    rough = with_yaw_of(SLOW_RECORD, usual) if is_slow_and_untuned(platform, interval) else ROUGH_WATER
    return {"usual": for_weight(usual, weight), "rough_water": for_weight(rough, weight)}


def with_yaw_of(source: DisturbancePrior, prior: DisturbancePrior) -> DisturbancePrior:
    """Return a prior with the yawing moment's numbers of another one."""
    return DisturbancePrior(
        deviation=(*prior.deviation[:5], source.deviation[5]),
        correlation_time=(*prior.correlation_time[:5], source.correlation_time[5]),
    )


SLOW_RECORD = DisturbancePrior(
    deviation=(0.1, 0.4, 0.2, 0.4, 3.0, 3.0), correlation_time=(300.0, 60.0, 300.0, 3600.0, 60.0, 60.0)
)
"""Prior of the smoother for slow records of a hull that has not been tuned (docs/smoother.md)."""


def smoother_prior(
    platform: Platform, prior: DisturbancePrior, interval: float = 0.0, weight: float = USUAL_WEIGHT
) -> DisturbancePrior:
    """Disturbance prior of the smoother, given that of the filter, and interval and weight as for `candidate_priors`.

    It is the filter's except for slow records of a hull without a prior of its own. There the errors of the hull's
    buoyancy, lift and pitching moment change with depth. With a correlation time of an hour the smoother would
    attribute such changes to the speed. The prior therefore lets these channels change within minutes. The yawing
    moment is free: the rate of turn determines the speed only as well as the turning coefficients are known, and glides
    hardly determine these. A tight prior of the yawing moment would reduce the speed of a calibrated Seaglider by a
    quarter.
    """
    return for_weight(SLOW_RECORD, weight) if is_slow_and_untuned(platform, interval) else prior


def is_slow(platform: Platform, interval: float) -> bool:
    """Return whether a hull has slow sensors, or a record's attitude a long interval, s."""
    return platform.sensors.sample_interval > SLOW_SENSORS_PRIOR or interval > _SLOW_RATIO * SLOW_SENSORS_PRIOR


def is_slow_and_untuned(platform: Platform, interval: float) -> bool:
    """Return whether a hull without a prior of its own has slow sensors, or a record's attitude a long interval, s."""
    return platform.prior is None and is_slow(platform, interval)


def default_prior(platform: Platform, interval: float = 0.0) -> DisturbancePrior:
    """The platform's disturbance prior, or a usual one for its sensors.

    Parameters
    ----------
    platform : Platform
        The hull.
    interval : float
        Interval (s) of the record's attitude, which may be longer than the platform file's: decimated records, or those
        whose values were filled in. With the prior for fast records, gusts that such a record does not resolve had made
        the true hull's speed wrong by 0.1 m/s.

    Notes
    -----
    Yaw represents effects of the water within a minute, the other channels errors of the hull over an hour. Hulls with
    slow sensors are usually uncalibrated. Their pitch trim may be wrong by newton metres but hardly changes during a
    dive. Their surge has a tight prior because a slow record cannot separate it from heave, and impulses in yaw cannot
    be resolved.
    """
    if platform.prior is not None:
        return platform.prior
    if is_slow_and_untuned(platform, interval):
        return DisturbancePrior(
            deviation=(0.1, 0.4, 0.3, 0.4, 3.0, 0.3), correlation_time=(3600.0, 3600.0, 3600.0, 3600.0, 90000.0, 60.0)
        )
    return DisturbancePrior(
        deviation=(0.4, 0.1, 0.4, 0.1, 0.15, 1.0), correlation_time=(3600.0, 3600.0, 3600.0, 3600.0, 3600.0, 60.0)
    )
