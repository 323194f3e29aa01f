! Branch-free sine, cosine and arctangent (polynomials after Moshier's Cephes), accurate to 2 ulp: what eqs. 3, 4, 13 and
! 28 are computed with. Every selection computes both sides, so that a loop over lanes has no branch.
module elementary
  use parameters, only: dp
  implicit none
  private
  public :: round_to_integer, sincos, arctan2, wrap

  ! Adding and subtracting 1.5 * 2**52 rounds a double to the nearest integer (ties to even) without a library call.
  real(dp), parameter :: ROUND = 6755399441055744.0_dp
  real(dp), parameter :: TWO_OVER_PI = 0.6366197723675814_dp
  ! pi/2 in three parts (Cody and Waite), the first two with trailing zeros, so that k * part is exact for |k| < 2**20.
  real(dp), parameter :: PIO2_1 = 1.5707963267341256_dp
  real(dp), parameter :: PIO2_2 = 6.077100506303966e-11_dp
  real(dp), parameter :: PIO2_3 = 2.0222662487959506e-21_dp

  real(dp), parameter :: PIO2 = 1.5707963267948966_dp
  real(dp), parameter :: PIO4 = 0.7853981633974483_dp
  real(dp), parameter :: PI = 3.141592653589793_dp
  ! What pi/2 and pi/4 lack of the exact values.
  real(dp), parameter :: PIO2_LOW = 6.123233995736766e-17_dp
  real(dp), parameter :: PIO4_LOW = 3.061616997868383e-17_dp
  real(dp), parameter :: TAN_3PIO8 = 2.414213562373095_dp
  real(dp), parameter :: TAN_PIO8_SPLIT = 0.66_dp
  real(dp), parameter :: TINY_DENOMINATOR = 1e-300_dp

contains

  ! Nearest integer as a double, for |x| < 2**51.
  elemental function round_to_integer(x) result(nearest)
    real(dp), intent(in) :: x
    real(dp) :: nearest

    nearest = (x + ROUND) - ROUND
  end function round_to_integer

  ! Sine and cosine of x (rad): to 2 ulp for |x| < 1e3, to 3 for |x| < 1e6.
  elemental subroutine sincos(x, sine, cosine)
    real(dp), intent(in) :: x
    real(dp), intent(out) :: sine, cosine
    real(dp) :: k, t, z, s, c, quadrant
    logical :: odd

    k = round_to_integer(x * TWO_OVER_PI)
    t = ((x - k * PIO2_1) - k * PIO2_2) - k * PIO2_3
    z = t * t
    s = (((((1.58962301576546568060e-10_dp * z - 2.50507477628578072866e-8_dp) * z + 2.75573136213857245213e-6_dp) * z &
      - 1.98412698295895385996e-4_dp) * z + 8.33333333332211858878e-3_dp) * z - 1.66666666666666307295e-1_dp) * z * t + t
    c = (((((-1.13585365213876817300e-11_dp * z + 2.08757008419747316778e-9_dp) * z - 2.75573141792967388112e-7_dp) * z &
      + 2.48015872888517045348e-5_dp) * z - 1.38888888888730564116e-3_dp) * z + 4.16666666666665929218e-2_dp) * z * z &
      - 0.5_dp * z + 1.0_dp
    quadrant = k - 4.0_dp * round_to_integer(0.25_dp * k)  ! -2, -1, 0, 1 or 2
    odd = quadrant * quadrant == 1.0_dp
    sine = merge(c, s, odd)
    cosine = merge(s, c, odd)
    sine = merge(-sine, sine, quadrant < 0.0_dp .or. quadrant == 2.0_dp)
    cosine = merge(-cosine, cosine, quadrant > 0.0_dp .or. quadrant == -2.0_dp)
  end subroutine sincos

  ! Angle of the point (x, y) in (-pi, pi]; 0 at the origin.
  elemental function arctan2(y, x) result(angle)
    real(dp), intent(in) :: y, x
    real(dp) :: angle, s, t, numerator, denominator, offset, offset_low, a, z, p, q
    logical :: steep, middle

    s = abs(x)
    t = abs(y)
    steep = t > TAN_3PIO8 * s
    middle = t > TAN_PIO8_SPLIT * s
    numerator = merge(-s, merge(t - s, t, middle), steep)
    denominator = merge(t, merge(t + s, s, middle), steep)
    offset = merge(PIO2, merge(PIO4, 0.0_dp, middle), steep)
    offset_low = merge(PIO2_LOW, merge(PIO4_LOW, 0.0_dp, middle), steep)
    a = numerator / merge(denominator, TINY_DENOMINATOR, denominator > TINY_DENOMINATOR)
    z = a * a
    p = (((-8.750608600031904122785e-1_dp * z - 1.615753718733365076637e1_dp) * z - 7.500855792314704667340e1_dp) * z &
      - 1.228866684490136173410e2_dp) * z - 6.485021904942025371773e1_dp
    q = ((((z + 2.485846490142306297962e1_dp) * z + 1.650270098316988542046e2_dp) * z + 4.328810604912902668951e2_dp) * z &
      + 4.853903996359136964868e2_dp) * z + 1.945506571482613964425e2_dp
    angle = offset + (a * z * (p / q) + a + offset_low)
    angle = merge(PI - angle, angle, x < 0.0_dp)
    angle = merge(-angle, angle, y < 0.0_dp)
  end function arctan2

  ! The equivalent of an angle (rad) within half a turn of zero.
  elemental function wrap(angle) result(wrapped)
    real(dp), intent(in) :: angle
    real(dp) :: wrapped

    wrapped = angle - 2.0_dp * PI * round_to_integer(angle / (2.0_dp * PI))
  end function wrap

end module elementary
