"""Line search for the strong Wolfe conditions, after Moré and Thuente (1994), ACM TOMS 20, 286-307.

The caller evaluates the function at each trial step. The constants are those of L-BFGS-B (Zhu et al., 1997, ACM TOMS
23, 550-560); both engines thus search in the same way.
"""

from typing import NamedTuple

from gliderhpc.kernels.jit import exact_formula

DECREASE, CURVATURE, RELATIVE_WIDTH = 1e-3, 0.9, 0.1
LONGEST = 1e10
_EXPAND_MIN, _EXPAND_MOST, _SHRINK = 1.1, 4.0, 0.66

CONTINUE, FOUND, EXHAUSTED = 0, 1, 2
"""Results of `advance_search`: evaluate at ``step``; the conditions hold at the trial; no better step can be found."""


class Search(NamedTuple):
    """Progress of a search.

    ``step`` is the next trial; ``best_*`` is the step with the least value so far, and ``other_*`` the other end of the
    interval; ``least`` and ``most`` bound the trial. Flags and the two-valued ``stage`` are numbers, which allows a
    search to be stored in a row of an array.
    """

    step: float
    value0: float
    slope0: float
    bracketed: float
    stage: float
    best_step: float
    best_value: float
    best_slope: float
    other_step: float
    other_value: float
    other_slope: float
    least: float
    most: float
    width: float
    width_before: float


@exact_formula
def start_search(value, slope, step):
    """Start at a point with a given value and (negative) slope along the direction, with a first trial step."""
    return Search(
        step, value, slope, 0.0, 1.0, 0.0, value, slope, 0.0, value, slope, 0.0, step + _EXPAND_MOST * step,
        LONGEST, 2.0 * LONGEST,
    )  # fmt: skip


@exact_formula
def advance_search(search, value, slope):
    """Process value and slope at the trial step; return the search with its next trial, and the result."""
    s = search
    step = s.step
    bracketed = s.bracketed > 0.0
    test = DECREASE * s.slope0
    bound = s.value0 + step * test
    stage = 2.0 if (s.stage == 1.0 and value <= bound and slope >= 0.0) else s.stage
    if value <= bound and abs(slope) <= -CURVATURE * s.slope0:
        return s, FOUND
    if bracketed and (step <= s.least or step >= s.most or s.most - s.least <= RELATIVE_WIDTH * s.most):
        return s, EXHAUSTED
    if (step == LONGEST and value <= bound and slope <= test) or (step == 0.0 and (value > bound or slope >= test)):
        return s, EXHAUSTED
    # In the first stage, a lower value without sufficient decrease: use the function minus its required decrease.
    shift = test if (stage == 1.0 and value <= s.best_value and value > bound) else 0.0
    best = (s.best_step, s.best_value - s.best_step * shift, s.best_slope - shift)
    other = (s.other_step, s.other_value - s.other_step * shift, s.other_slope - shift)
    best, other, trial, bracketed = _next_trial(
        best, other, (step, value - step * shift, slope - shift), bracketed, s.least, s.most
    )
    width, width_before = s.width, s.width_before
    if bracketed:
        interval = abs(other[0] - best[0])
        if interval >= _SHRINK * width_before:
            trial = best[0] + 0.5 * (other[0] - best[0])
        width_before, width = width, interval
        least, most = min(best[0], other[0]), max(best[0], other[0])
    else:
        least = trial + _EXPAND_MIN * (trial - best[0])
        most = trial + _EXPAND_MOST * (trial - best[0])
    trial = min(max(trial, 0.0), LONGEST)
    if bracketed and (trial <= least or trial >= most or most - least <= RELATIVE_WIDTH * most):
        trial = best[0]
    return (
        Search(
            trial, s.value0, s.slope0, 1.0 if bracketed else 0.0, stage,
            best[0], best[1] + best[0] * shift, best[2] + shift,
            other[0], other[1] + other[0] * shift, other[2] + shift,
            least, most, width, width_before,
        ),
        CONTINUE,
    )  # fmt: skip


@exact_formula
def _next_trial(best, other, now, bracketed, least, most):
    """Return the new ends of the interval and a safeguarded step, from its ends and the trial (step, value, slope)."""
    x, fx, gx = best
    y, fy, gy = other
    t, f, g = now
    opposite = g * gx < 0.0
    theta = 3.0 * (fx - f) / (t - x) + gx + g
    size = max(abs(theta), abs(gx), abs(g))
    radicand = (theta / size) ** 2 - (gx / size) * (g / size)
    if f > fx:  # higher: the minimum is bracketed
        gamma = size * max(0.0, radicand) ** 0.5
        gamma = -gamma if t < x else gamma
        cubic = x + ((gamma - gx) + theta) / (((gamma - gx) + gamma) + g) * (t - x)
        quadratic = x + ((gx / ((fx - f) / (t - x) + gx)) / 2.0) * (t - x)
        closer = abs(cubic - x) < abs(quadratic - x)
        trial = cubic if closer else cubic + (quadratic - cubic) / 2.0
        bracketed = True
    elif opposite:  # lower, the slope has changed sign: bracketed
        gamma = size * max(0.0, radicand) ** 0.5
        gamma = -gamma if t > x else gamma
        cubic = t + ((gamma - g) + theta) / (((gamma - g) + gamma) + gx) * (x - t)
        secant = t + (g / (g - gx)) * (x - t)
        trial = cubic if abs(cubic - t) > abs(secant - t) else secant
        bracketed = True
    elif abs(g) < abs(gx):  # lower, the slope flattens: the cubic may have no minimum beyond
        gamma = size * max(0.0, radicand) ** 0.5
        gamma = -gamma if t > x else gamma
        ratio = ((gamma - g) + theta) / ((gamma + (gx - g)) + gamma)
        bound = most if t > x else least
        cubic = t + ratio * (x - t) if ratio < 0.0 and gamma != 0.0 else bound
        secant = t + (g / (g - gx)) * (x - t)
        if bracketed:
            trial = cubic if abs(cubic - t) < abs(secant - t) else secant
            limit = t + _SHRINK * (y - t)
            trial = min(limit, trial) if t > x else max(limit, trial)
        else:
            trial = cubic if abs(cubic - t) > abs(secant - t) else secant
            trial = max(least, min(most, trial))
    elif bracketed:  # lower, the slope steepens: between the trial and the other end
        theta = 3.0 * (f - fy) / (y - t) + gy + g
        size = max(abs(theta), abs(gy), abs(g))
        gamma = size * max(0.0, (theta / size) ** 2 - (gy / size) * (g / size)) ** 0.5
        gamma = -gamma if t > y else gamma
        trial = t + ((gamma - g) + theta) / (((gamma - g) + gamma) + gy) * (y - t)
    else:
        trial = most if t > x else least
    if f > fx:
        return best, now, trial, bracketed
    if opposite:
        return now, best, trial, bracketed
    return now, other, trial, bracketed
