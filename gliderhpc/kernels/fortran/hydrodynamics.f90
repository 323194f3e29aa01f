! Viscous forces and moments (eqs. 11-14) and their derivatives.
!
! The rotation R_bf needs no trigonometry: with U = hypot(u, w) and V = |velocity|, cos(alpha) = u/U, sin(alpha) = w/U,
! cos(beta) = U/V and sin(beta) = v/V. Below REST (m2/s2) the hull counts as at rest: angles are zero and every force and
! derivative vanishes.
module hydrodynamics
  use elementary, only: arctan2
  use parameters, only: dp, hull_type
  implicit none
  private
  public :: bearing_of, flow_along, flow_of, load_of, to_body, to_flow, viscous_vjp, viscous_partials
  public :: flow_type, load_type, bearing_type

  real(dp), parameter :: REST = 1e-200_dp

  ! Direction of the flow: squared speed, angles (eq. 13), their cosines and sines, speed in the x-z plane, reciprocal
  ! squared speeds.
  type :: flow_type
    real(dp) :: V2, alpha, beta, ca, sa, cb, sb, planar, inv_U2, inv_V2
  end type flow_type

  ! Viscous force and moment in the flow frame: [-D, SF, -L] and [M_DL1, M_DL2, M_DL3] of eqs. 11 and 12.
  type :: load_type
    real(dp) :: f1, f2, f3, m1, m2, m3
  end type load_type

  ! What is costly to know of a flow: its angles (eq. 13) and the reciprocal speeds in the x-z plane and in all.
  type :: bearing_type
    real(dp) :: alpha, beta, inv_U, inv_V
  end type bearing_type

contains

  ! Angle of attack, sideslip (eq. 13) and reciprocal speeds; zero where there is no flow.
  pure function bearing_of(u, v, w) result(bearing)
    real(dp), intent(in) :: u, v, w
    type(bearing_type) :: bearing
    real(dp) :: U2, V2
    logical :: moving, planar

    U2 = u * u + w * w
    V2 = U2 + v * v
    moving = V2 > REST
    planar = U2 > REST
    ! Both sides of a selection are computed: what is not wanted must not divide by zero.
    bearing%inv_U = sqrt(merge(1.0_dp / merge(U2, 1.0_dp, planar), 0.0_dp, planar))
    bearing%inv_V = sqrt(merge(1.0_dp / merge(V2, 1.0_dp, moving), 0.0_dp, moving))
    bearing%alpha = arctan2(w, u)
    bearing%beta = arctan2(v, U2 * bearing%inv_U)
  end function bearing_of

  ! Everything that is used of the flow, from its bearing.
  pure function flow_along(bearing, u, v, w) result(flow)
    type(bearing_type), intent(in) :: bearing
    real(dp), intent(in) :: u, v, w
    type(flow_type) :: flow
    real(dp) :: U2

    U2 = u * u + w * w
    flow%V2 = U2 + v * v
    flow%alpha = bearing%alpha
    flow%beta = bearing%beta
    flow%planar = U2 * bearing%inv_U
    flow%ca = merge(u * bearing%inv_U, 1.0_dp, bearing%inv_U > 0.0_dp)
    flow%sa = w * bearing%inv_U
    flow%cb = merge(flow%planar * bearing%inv_V, 1.0_dp, bearing%inv_V > 0.0_dp)
    flow%sb = v * bearing%inv_V
    flow%inv_U2 = bearing%inv_U * bearing%inv_U
    flow%inv_V2 = bearing%inv_V * bearing%inv_V
  end function flow_along

  ! Speed, angle of attack and sideslip (eq. 13).
  pure function flow_of(u, v, w) result(flow)
    real(dp), intent(in) :: u, v, w
    type(flow_type) :: flow

    flow = flow_along(bearing_of(u, v, w), u, v, w)
  end function flow_of

  ! Forces and moments in the flow frame (eqs. 11, 12), the rudder's yaw moment included.
  pure function load_of(hull, rudder, flow, p, q, r) result(load)
    type(hull_type), intent(in) :: hull
    type(flow_type), intent(in) :: flow
    real(dp), intent(in) :: rudder, p, q, r
    type(load_type) :: load
    real(dp) :: alpha, beta, V2, W2

    alpha = flow%alpha
    beta = flow%beta
    V2 = flow%V2
    W2 = V2 + hull%rate_floor2
    load%f1 = -V2 * (hull%K_D0 + hull%K_D * alpha * alpha)
    load%f2 = V2 * hull%K_beta * beta
    load%f3 = -V2 * (hull%K_L0 + hull%K_L * alpha)
    load%m1 = V2 * hull%K_MR * beta + W2 * hull%K_p * p
    load%m2 = V2 * (hull%K_M0 + hull%K_M * alpha) + W2 * hull%K_q * q
    load%m3 = V2 * (hull%K_MY * beta + hull%K_delta * rudder) + W2 * hull%K_r * r
  end function load_of

  ! Rotate a vector from the flow frame to the body frame: R_bf of eq. 14.
  pure subroutine to_body(flow, a1, a2, a3, ax, ay, az)
    type(flow_type), intent(in) :: flow
    real(dp), intent(in) :: a1, a2, a3
    real(dp), intent(out) :: ax, ay, az
    real(dp) :: planar

    planar = flow%cb * a1 - flow%sb * a2
    ax = flow%ca * planar - flow%sa * a3
    ay = flow%sb * a1 + flow%cb * a2
    az = flow%sa * planar + flow%ca * a3
  end subroutine to_body

  ! Rotate a vector from the body frame to the flow frame: the transpose of R_bf.
  pure subroutine to_flow(flow, ax, ay, az, a1, a2, a3)
    type(flow_type), intent(in) :: flow
    real(dp), intent(in) :: ax, ay, az
    real(dp), intent(out) :: a1, a2, a3
    real(dp) :: planar

    planar = flow%ca * ax + flow%sa * az
    a1 = flow%cb * planar + flow%sb * ay
    a2 = flow%cb * ay - flow%sb * planar
    a3 = flow%ca * az - flow%sa * ax
  end subroutine to_flow

  ! Transpose of the derivative of (F_v, M_v) with respect to (u, v, w, p, q, r), applied to (f, m).
  pure subroutine viscous_vjp(hull, rudder, u, v, w, p, q, r, flow, load, fx, fy, fz, mx, my, mz, &
      d_u, d_v, d_w, d_p, d_q, d_r)
    type(hull_type), intent(in) :: hull
    type(flow_type), intent(in) :: flow
    type(load_type), intent(in) :: load
    real(dp), intent(in) :: rudder, u, v, w, p, q, r, fx, fy, fz, mx, my, mz
    real(dp), intent(out) :: d_u, d_v, d_w, d_p, d_q, d_r
    real(dp) :: alpha, beta, V2, W2, a1, a2, a3, b1, b2, b3, planar_f, planar_m, planar_a, planar_b
    real(dp) :: d_alpha, d_beta, d_V2, turn, slip

    alpha = flow%alpha
    beta = flow%beta
    V2 = flow%V2
    W2 = V2 + hull%rate_floor2
    call to_flow(flow, fx, fy, fz, a1, a2, a3)
    call to_flow(flow, mx, my, mz, b1, b2, b3)
    ! Turning R_bf by d(alpha) exchanges flow axes 1-2 with 3; by d(beta), 1 with 2.
    planar_f = flow%cb * load%f1 - flow%sb * load%f2
    planar_m = flow%cb * load%m1 - flow%sb * load%m2
    planar_a = flow%cb * a1 - flow%sb * a2
    planar_b = flow%cb * b1 - flow%sb * b2
    d_alpha = a3 * planar_f - load%f3 * planar_a + b3 * planar_m - load%m3 * planar_b &
      + V2 * (-2.0_dp * hull%K_D * alpha * a1 - hull%K_L * a3 + hull%K_M * b2)
    d_beta = a2 * load%f1 - a1 * load%f2 + b2 * load%m1 - b1 * load%m2 &
      + V2 * (hull%K_beta * a2 + hull%K_MR * b1 + hull%K_MY * b3)
    d_V2 = -(hull%K_D0 + hull%K_D * alpha * alpha) * a1 &
      + hull%K_beta * beta * a2 &
      - (hull%K_L0 + hull%K_L * alpha) * a3 &
      + (hull%K_MR * beta + hull%K_p * p) * b1 &
      + (hull%K_M0 + hull%K_M * alpha + hull%K_q * q) * b2 &
      + (hull%K_MY * beta + hull%K_delta * rudder + hull%K_r * r) * b3
    turn = flow%inv_U2 * d_alpha
    slip = flow%inv_V2 * d_beta
    d_u = 2.0_dp * u * d_V2 - w * turn - v * flow%ca * slip
    d_v = 2.0_dp * v * d_V2 + flow%planar * slip
    d_w = 2.0_dp * w * d_V2 + u * turn - v * flow%sa * slip
    d_p = W2 * hull%K_p * b1
    d_q = W2 * hull%K_q * b2
    d_r = W2 * hull%K_r * b3
  end subroutine viscous_vjp

  ! Derivatives of (F_v, M_v), body frame, with respect to alpha, beta and V2: six entries each.
  pure subroutine viscous_partials(hull, rudder, flow, load, p, q, r, by_alpha, by_beta, by_V2)
    type(hull_type), intent(in) :: hull
    type(flow_type), intent(in) :: flow
    type(load_type), intent(in) :: load
    real(dp), intent(in) :: rudder, p, q, r
    real(dp), intent(out) :: by_alpha(6), by_beta(6), by_V2(6)
    real(dp) :: alpha, beta, V2, planar_f, planar_m, ax, ay, az

    alpha = flow%alpha
    beta = flow%beta
    V2 = flow%V2
    planar_f = flow%cb * load%f1 - flow%sb * load%f2
    planar_m = flow%cb * load%m1 - flow%sb * load%m2
    call to_body(flow, -2.0_dp * V2 * hull%K_D * alpha, 0.0_dp, -V2 * hull%K_L, ax, ay, az)
    by_alpha(1) = ax - flow%sa * planar_f - flow%ca * load%f3
    by_alpha(2) = ay
    by_alpha(3) = az + flow%ca * planar_f - flow%sa * load%f3
    call to_body(flow, 0.0_dp, V2 * hull%K_M, 0.0_dp, ax, ay, az)
    by_alpha(4) = ax - flow%sa * planar_m - flow%ca * load%m3
    by_alpha(5) = ay
    by_alpha(6) = az + flow%ca * planar_m - flow%sa * load%m3
    call to_body(flow, -load%f2, load%f1 + V2 * hull%K_beta, 0.0_dp, by_beta(1), by_beta(2), by_beta(3))
    call to_body(flow, V2 * hull%K_MR - load%m2, load%m1, V2 * hull%K_MY, by_beta(4), by_beta(5), by_beta(6))
    call to_body(flow, -(hull%K_D0 + hull%K_D * alpha * alpha), hull%K_beta * beta, &
      -(hull%K_L0 + hull%K_L * alpha), by_V2(1), by_V2(2), by_V2(3))
    call to_body(flow, hull%K_MR * beta + hull%K_p * p, hull%K_M0 + hull%K_M * alpha + hull%K_q * q, &
      hull%K_MY * beta + hull%K_delta * rudder + hull%K_r * r, by_V2(4), by_V2(5), by_V2(6))
  end subroutine viscous_partials

end module hydrodynamics
