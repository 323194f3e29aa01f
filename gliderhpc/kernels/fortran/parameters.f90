! Constants of a hull (eqs. 7, 8, 11, 12) and mass properties of a control sample (eqs. 5, 9), as the formulas take them.
!
! Arrays hold a lane along their first axis, `width` of them; a single point is an array of width 1.
module parameters
  use, intrinsic :: iso_c_binding, only: dp => c_double
  implicit none
  private
  public :: dp, load_hull, load_body, hull_type, body_type
  real(dp), parameter, public :: GRAVITY = 9.81_dp
  integer, parameter, public :: HULL_SIZE = 24, BODY_SIZE = 11

  type :: hull_type
    real(dp) :: mass_u, mass_v, mass_w, inertia_p, inertia_q, inertia_r, added_p, added_q, added_r
    real(dp) :: depth_slope
    real(dp) :: K_D0, K_D, K_beta, K_L0, K_L, K_MR, K_p, K_M0, K_M, K_q, K_MY, K_r, K_delta
    real(dp) :: rate_floor2
  end type hull_type

  type :: body_type
    real(dp) :: Sx, Sy, Sz, Jxx, Jyy, Jzz, Jxy, Jxz, Jyz, net_weight, rudder
  end type body_type

contains

  pure function load_hull(width, hull, lane) result(constants)
    integer, intent(in) :: width, lane
    real(dp), intent(in) :: hull(width, HULL_SIZE)
    type(hull_type) :: constants

    constants = hull_type( &
      hull(lane, 1), hull(lane, 2), hull(lane, 3), hull(lane, 4), hull(lane, 5), hull(lane, 6), &
      hull(lane, 7), hull(lane, 8), hull(lane, 9), hull(lane, 10), hull(lane, 11), hull(lane, 12), &
      hull(lane, 13), hull(lane, 14), hull(lane, 15), hull(lane, 16), hull(lane, 17), hull(lane, 18), &
      hull(lane, 19), hull(lane, 20), hull(lane, 21), hull(lane, 22), hull(lane, 23), hull(lane, 24))
  end function load_hull

  pure function load_body(width, bodies, lane) result(body)
    integer, intent(in) :: width, lane
    real(dp), intent(in) :: bodies(width, BODY_SIZE)
    type(body_type) :: body

    body = body_type( &
      bodies(lane, 1), bodies(lane, 2), bodies(lane, 3), bodies(lane, 4), bodies(lane, 5), bodies(lane, 6), &
      bodies(lane, 7), bodies(lane, 8), bodies(lane, 9), bodies(lane, 10), bodies(lane, 11))
  end function load_body

end module parameters
