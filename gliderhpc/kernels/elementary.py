"""Branch-free sine, cosine and arctangent (polynomials after Moshier's Cephes), accurate to 2 ulp.

The library functions cost 9 to 13 ns each and prevent a loop from vectorising; these consist of multiplications,
additions and selections only.
"""

from gliderhpc.kernels.elementwise import select
from gliderhpc.kernels.jit import exact_formula

# Adding and subtracting 1.5 * 2**52 rounds a double to the nearest integer (ties to even) without a library call.
_ROUND = 6755399441055744.0
_TWO_OVER_PI = 0.6366197723675814
# pi/2 in three parts (Cody and Waite); the first two have trailing zeros, and k * part is exact for |k| < 2**20.
_PIO2_1 = 1.5707963267341256
_PIO2_2 = 6.077100506303966e-11
_PIO2_3 = 2.0222662487959506e-21

_PIO2 = 1.5707963267948966
_PIO4 = 0.7853981633974483
_PI = 3.141592653589793
# Differences of the exact pi/2 and pi/4 from the doubles above.
_PIO2_LOW = 6.123233995736766e-17
_PIO4_LOW = 3.061616997868383e-17
_TAN_3PIO8 = 2.414213562373095
_TAN_PIO8_SPLIT = 0.66
_TINY = 1e-300


@exact_formula
def round_to_integer(x):
    """Return the nearest integer as a double, for ``|x| < 2**51``."""
    return (x + _ROUND) - _ROUND


@exact_formula
def sincos(x):
    """Return sine and cosine of ``x`` (rad), accurate to 2 ulp for ``|x| < 1e3`` and to 3 ulp for ``|x| < 1e6``."""
    k = round_to_integer(x * _TWO_OVER_PI)
    t = ((x - k * _PIO2_1) - k * _PIO2_2) - k * _PIO2_3
    z = t * t
    s = (
        ((((1.58962301576546568060e-10 * z - 2.50507477628578072866e-8) * z + 2.75573136213857245213e-6) * z
          - 1.98412698295895385996e-4) * z + 8.33333333332211858878e-3) * z - 1.66666666666666307295e-1
    ) * z * t + t  # fmt: skip
    c = (
        ((((-1.13585365213876817300e-11 * z + 2.08757008419747316778e-9) * z - 2.75573141792967388112e-7) * z
          + 2.48015872888517045348e-5) * z - 1.38888888888730564116e-3) * z + 4.16666666666665929218e-2
    ) * z * z - 0.5 * z + 1.0  # fmt: skip
    quadrant = k - 4.0 * round_to_integer(0.25 * k)  # -2, -1, 0, 1 or 2
    odd = quadrant * quadrant == 1.0
    sine = select(odd, c, s)
    cosine = select(odd, s, c)
    sine = select((quadrant < 0.0) | (quadrant == 2.0), -sine, sine)
    cosine = select((quadrant > 0.0) | (quadrant == -2.0), -cosine, cosine)
    return sine, cosine


@exact_formula
def arctan2(y, x):
    """Return the angle of the point ``(x, y)`` in (-pi, pi]; 0 at the origin."""
    s = abs(x)
    t = abs(y)
    steep = t > _TAN_3PIO8 * s
    middle = t > _TAN_PIO8_SPLIT * s
    numerator = select(steep, -s, select(middle, t - s, t))
    denominator = select(steep, t, select(middle, t + s, s))
    offset = select(steep, _PIO2, select(middle, _PIO4, 0.0))
    offset_low = select(steep, _PIO2_LOW, select(middle, _PIO4_LOW, 0.0))
    a = numerator / select(denominator > _TINY, denominator, _TINY)
    z = a * a
    p = (
        ((-8.750608600031904122785e-1 * z - 1.615753718733365076637e1) * z - 7.500855792314704667340e1) * z
        - 1.228866684490136173410e2
    ) * z - 6.485021904942025371773e1
    q = (
        (((z + 2.485846490142306297962e1) * z + 1.650270098316988542046e2) * z + 4.328810604912902668951e2) * z
        + 4.853903996359136964868e2
    ) * z + 1.945506571482613964425e2
    angle = offset + (a * z * (p / q) + a + offset_low)
    angle = select(x < 0.0, _PI - angle, angle)
    return select(y < 0.0, -angle, angle)


@exact_formula
def wrap(angle):
    """Return the equivalent of ``angle`` (rad) within half a turn of zero."""
    return angle - 2.0 * _PI * round_to_integer(angle / (2.0 * _PI))
