! The Jacobian of the twelve rates (eqs. 1-14, 20 differentiated, for eqs. 23 and 24) by hand: 79 of its 144 entries can
! differ from zero.
!
! The ten sensed states, [phi, theta, psi, Z, u, v, w, p, q, r], have 67 of them, in a list row by row: ENTRY_ROW and
! ENTRY_COLUMN say which. The other twelve are those of X and Y, on which nothing depends.
module jacobian
  use dynamics, only: momenta
  use elementary, only: sincos
  use hydrodynamics, only: flow_of, load_of, viscous_partials, flow_type, load_type
  use parameters, only: dp, hull_type, body_type, GRAVITY
  implicit none
  private
  public :: store_partials, pulled, rhs_jacobian

  integer, parameter, public :: ENTRIES = 67
  integer, parameter, public :: ENTRY_ROW(ENTRIES) = [ &
    1, 1, 1, 1, 1, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4, 4, 5, 5, 5, 5, 5, 5, 5, 5, 6, 6, 6, 6, 6, 6, 6, 6, 6, &
    7, 7, 7, 7, 7, 7, 7, 7, 7, 8, 8, 8, 8, 8, 8, 8, 8, 9, 9, 9, 9, 9, 9, 9, 9, 10, 10, 10, 10, 10, 10, 10, 10]
  integer, parameter, public :: ENTRY_COLUMN(ENTRIES) = [ &
    1, 2, 8, 9, 10, 1, 9, 10, 1, 2, 9, 10, 1, 2, 5, 6, 7, 2, 4, 5, 6, 7, 8, 9, 10, 1, 2, 4, 5, 6, 7, 8, 9, 10, &
    1, 2, 4, 5, 6, 7, 8, 9, 10, 1, 2, 5, 6, 7, 8, 9, 10, 1, 2, 5, 6, 7, 8, 9, 10, 1, 2, 5, 6, 7, 8, 9, 10]

  integer, parameter :: AMONG_TWELVE(10) = [1, 2, 3, 6, 7, 8, 9, 10, 11, 12]

contains

  ! Derivatives of P x Omega and Pi x Omega + P x V by the velocities: rows of six.
  pure subroutine momentum_partials(hull, body, u, v, w, p, q, r, of_u, of_v, of_w, of_p, of_q, of_r)
    type(hull_type), intent(in) :: hull
    type(body_type), intent(in) :: body
    real(dp), intent(in) :: u, v, w, p, q, r
    real(dp), intent(out) :: of_u(6), of_v(6), of_w(6), of_p(6), of_q(6), of_r(6)
    real(dp) :: Pu, Pv, Pw, Lp, Lq, Lr, mu, mv, mw, Sx, Sy, Sz, J1, J2, J3, Jxy, Jxz, Jyz

    call momenta(hull, body, u, v, w, p, q, r, Pu, Pv, Pw, Lp, Lq, Lr)
    mu = hull%mass_u
    mv = hull%mass_v
    mw = hull%mass_w
    Sx = body%Sx
    Sy = body%Sy
    Sz = body%Sz
    J1 = hull%added_p + body%Jxx
    J2 = hull%added_q + body%Jyy
    J3 = hull%added_r + body%Jzz
    Jxy = body%Jxy
    Jxz = body%Jxz
    Jyz = body%Jyz
    of_u = [0.0_dp, mv * r, -mw * q, -Sy * q - Sz * r, Sx * q - Pw, Sx * r + Pv]
    of_v = [-mu * r, 0.0_dp, mw * p, Sy * p + Pw, -Sx * p - Sz * r, Sy * r - Pu]
    of_w = [mu * q, -mv * p, 0.0_dp, Sz * p - Pv, Sz * q + Pu, -Sx * p - Sy * q]
    of_p = [Sy * q + Sz * r, mv * w - Pw - Sx * q, Pv - mw * v - Sx * r, &
      Jxy * r - Jxz * q - Sy * v - Sz * w, J2 * r - Jyz * q - Lr + Sx * v, Jyz * r - J3 * q + Lq + Sx * w]
    of_q = [Pw - mu * w - Sy * p, Sx * p + Sz * r, mw * u - Pu - Sy * r, &
      Jxz * p - J1 * r + Lr + Sy * u, Jyz * p - Jxy * r - Sx * u - Sz * w, J3 * p - Jxz * r - Lp + Sy * w]
    of_r = [mu * v - Pv - Sz * p, Pu - mv * u - Sz * q, Sx * p + Sy * q, &
      J1 * q - Jxy * p - Lq + Sz * u, Jxy * q - J2 * p + Lp + Sz * v, Jxz * q - Jyz * p - Sx * u - Sy * v]
  end subroutine momentum_partials

  ! Six entries of one row: momentum terms and viscous loads by u, v and w; momentum terms by p, q and r.
  pure function velocity_row(momentum, by_alpha, by_beta, by_V2, directions, scale) result(row)
    real(dp), intent(in) :: momentum(6), by_alpha, by_beta, by_V2, directions(8), scale
    real(dp) :: row(6)

    row(1) = scale * (momentum(1) + by_alpha * directions(1) + by_beta * directions(3) + by_V2 * directions(6))
    row(2) = scale * (momentum(2) + by_beta * directions(4) + by_V2 * directions(7))
    row(3) = scale * (momentum(3) + by_alpha * directions(2) + by_beta * directions(5) + by_V2 * directions(8))
    row(4) = scale * momentum(4)
    row(5) = scale * momentum(5)
    row(6) = scale * momentum(6)
  end function velocity_row

  ! Write `scale` times the sensed states' Jacobian at y into one lane of `list`.
  pure subroutine store_partials(width, lane, hull, body, y, scale, list)
    integer, intent(in) :: width, lane
    type(hull_type), intent(in) :: hull
    type(body_type), intent(in) :: body
    real(dp), intent(in) :: y(10), scale
    real(dp), intent(inout) :: list(width, ENTRIES)
    type(flow_type) :: flow
    type(load_type) :: load
    real(dp) :: Z, u, v, w, p, q, r, sp, cp, st, ct, kx, ky, kz, inv_ct, tt, turn, nod
    real(dp) :: by_alpha(6), by_beta(6), by_V2(6), directions(8), a1, a2, a3, a4, a5, a6
    real(dp) :: of_u(6), of_v(6), of_w(6), of_p(6), of_q(6), of_r(6)
    real(dp) :: W2, dp_, dq, dr, planar_p, planar_q, buoyancy, slope, Sx, Sy, Sz, tx, ty, tz

    Z = y(4)
    u = y(5)
    v = y(6)
    w = y(7)
    p = y(8)
    q = y(9)
    r = y(10)
    call sincos(y(1), sp, cp)
    call sincos(y(2), st, ct)
    kx = -st
    ky = sp * ct
    kz = cp * ct
    ! Rows phi, theta and psi (eq. 4), and Z.
    inv_ct = 1.0_dp / ct
    tt = st * inv_ct
    turn = sp * q + cp * r
    nod = cp * q - sp * r
    list(lane, 1:5) = scale * [tt * nod, turn * inv_ct * inv_ct, 1.0_dp, sp * tt, cp * tt]
    list(lane, 6:8) = scale * [-turn, cp, -sp]
    list(lane, 9:12) = scale * [nod * inv_ct, turn * inv_ct * tt, sp * inv_ct, cp * inv_ct]
    list(lane, 13:17) = scale * [kz * v - ky * w, -ct * u - st * (sp * v + cp * w), kx, ky, kz]

    ! Velocities by velocities: momenta and viscous loads.
    flow = flow_of(u, v, w)
    load = load_of(hull, body%rudder, flow, p, q, r)
    call viscous_partials(hull, body%rudder, flow, load, p, q, r, by_alpha, by_beta, by_V2)
    call momentum_partials(hull, body, u, v, w, p, q, r, of_u, of_v, of_w, of_p, of_q, of_r)
    directions = [-w * flow%inv_U2, u * flow%inv_U2, &
      -v * flow%ca * flow%inv_V2, flow%planar * flow%inv_V2, -v * flow%sa * flow%inv_V2, &
      2.0_dp * u, 2.0_dp * v, 2.0_dp * w]
    a1 = scale / hull%mass_u
    a2 = scale / hull%mass_v
    a3 = scale / hull%mass_w
    a4 = scale / hull%inertia_p
    a5 = scale / hull%inertia_q
    a6 = scale / hull%inertia_r
    of_u = velocity_row(of_u, by_alpha(1), by_beta(1), by_V2(1), directions, a1)
    of_v = velocity_row(of_v, by_alpha(2), by_beta(2), by_V2(2), directions, a2)
    of_w = velocity_row(of_w, by_alpha(3), by_beta(3), by_V2(3), directions, a3)
    of_p = velocity_row(of_p, by_alpha(4), by_beta(4), by_V2(4), directions, a4)
    of_q = velocity_row(of_q, by_alpha(5), by_beta(5), by_V2(5), directions, a5)
    of_r = velocity_row(of_r, by_alpha(6), by_beta(6), by_V2(6), directions, a6)
    W2 = flow%V2 + hull%rate_floor2
    dp_ = W2 * hull%K_p
    dq = W2 * hull%K_q
    dr = W2 * hull%K_r
    planar_p = flow%cb * dp_
    planar_q = flow%sb * dq

    ! Velocities by attitude and depth: gravity's direction and the depth slope of the buoyancy.
    buoyancy = body%net_weight - hull%depth_slope * Z
    slope = -hull%depth_slope
    Sx = GRAVITY * body%Sx
    Sy = GRAVITY * body%Sy
    Sz = GRAVITY * body%Sz
    tx = -ct
    ty = -st * sp
    tz = -st * cp
    list(lane, 18:19) = [a1 * (buoyancy * tx), a1 * (slope * kx)]
    list(lane, 20:25) = of_u
    list(lane, 26:28) = [a2 * (buoyancy * kz), a2 * (buoyancy * ty), a2 * (slope * ky)]
    list(lane, 29:34) = of_v
    list(lane, 35:37) = [-a3 * (buoyancy * ky), a3 * (buoyancy * tz), a3 * (slope * kz)]
    list(lane, 38:43) = of_w
    list(lane, 44:51) = [-a4 * (Sy * ky + Sz * kz), a4 * (Sy * tz - Sz * ty), of_p(1), of_p(2), of_p(3), &
      of_p(4) + a4 * (flow%ca * planar_p), of_p(5) - a4 * (flow%ca * planar_q), of_p(6) - a4 * (flow%sa * dr)]
    list(lane, 52:59) = [a5 * (Sx * ky), a5 * (Sz * tx - Sx * tz), of_q(1), of_q(2), of_q(3), &
      of_q(4) + a5 * (flow%sb * dp_), of_q(5) + a5 * (flow%cb * dq), of_q(6)]
    list(lane, 60:67) = [a6 * (Sx * kz), a6 * (Sx * ty - Sy * tx), of_r(1), of_r(2), of_r(3), &
      of_r(4) + a6 * (flow%sa * planar_p), of_r(5) - a6 * (flow%sa * planar_q), of_r(6) + a6 * (flow%ca * dr)]
  end subroutine store_partials

  ! Transpose of the Jacobian in one lane of the list `e` applied to a costate n (ten). Nothing depends on psi: zero.
  pure function pulled(width, lane, e, n) result(f)
    integer, intent(in) :: width, lane
    real(dp), intent(in) :: e(width, ENTRIES), n(10)
    real(dp) :: f(10)

    f(1) = e(lane, 1) * n(1) + e(lane, 6) * n(2) + e(lane, 9) * n(3) + e(lane, 13) * n(4) &
      + e(lane, 26) * n(6) + e(lane, 35) * n(7) &
      + e(lane, 44) * n(8) + e(lane, 52) * n(9) + e(lane, 60) * n(10)
    f(2) = e(lane, 2) * n(1) + e(lane, 10) * n(3) + e(lane, 14) * n(4) &
      + e(lane, 18) * n(5) + e(lane, 27) * n(6) + e(lane, 36) * n(7) &
      + e(lane, 45) * n(8) + e(lane, 53) * n(9) + e(lane, 61) * n(10)
    f(3) = 0.0_dp
    f(4) = e(lane, 19) * n(5) + e(lane, 28) * n(6) + e(lane, 37) * n(7)
    f(5) = e(lane, 15) * n(4) + e(lane, 20) * n(5) + e(lane, 29) * n(6) + e(lane, 38) * n(7) &
      + e(lane, 46) * n(8) + e(lane, 54) * n(9) + e(lane, 62) * n(10)
    f(6) = e(lane, 16) * n(4) + e(lane, 21) * n(5) + e(lane, 30) * n(6) + e(lane, 39) * n(7) &
      + e(lane, 47) * n(8) + e(lane, 55) * n(9) + e(lane, 63) * n(10)
    f(7) = e(lane, 17) * n(4) + e(lane, 22) * n(5) + e(lane, 31) * n(6) + e(lane, 40) * n(7) &
      + e(lane, 48) * n(8) + e(lane, 56) * n(9) + e(lane, 64) * n(10)
    f(8) = e(lane, 3) * n(1) &
      + e(lane, 23) * n(5) + e(lane, 32) * n(6) + e(lane, 41) * n(7) &
      + e(lane, 49) * n(8) + e(lane, 57) * n(9) + e(lane, 65) * n(10)
    f(9) = e(lane, 4) * n(1) + e(lane, 7) * n(2) + e(lane, 11) * n(3) &
      + e(lane, 24) * n(5) + e(lane, 33) * n(6) + e(lane, 42) * n(7) &
      + e(lane, 50) * n(8) + e(lane, 58) * n(9) + e(lane, 66) * n(10)
    f(10) = e(lane, 5) * n(1) + e(lane, 8) * n(2) + e(lane, 12) * n(3) &
      + e(lane, 25) * n(5) + e(lane, 34) * n(6) + e(lane, 43) * n(7) &
      + e(lane, 51) * n(8) + e(lane, 59) * n(9) + e(lane, 67) * n(10)
  end function pulled

  ! Rows X and Y (eq. 3): the horizontal velocity is (ahead, across) turned by the heading.
  pure subroutine store_track_partials(y, out)
    real(dp), intent(in) :: y(10)
    real(dp), intent(inout) :: out(12, 12)
    real(dp) :: u, v, w, sp, cp, st, ct, ss, cs, ahead, across
    real(dp) :: ahead_phi, across_phi, ahead_theta

    u = y(5)
    v = y(6)
    w = y(7)
    call sincos(y(1), sp, cp)
    call sincos(y(2), st, ct)
    call sincos(y(3), ss, cs)
    ahead = ct * u + st * (sp * v + cp * w)
    across = cp * v - sp * w
    ahead_phi = st * across
    across_phi = -(sp * v + cp * w)
    ahead_theta = -st * u + ct * (sp * v + cp * w)
    out(4:5, 1) = [cs * ahead_phi - ss * across_phi, ss * ahead_phi + cs * across_phi]
    out(4:5, 2) = [cs * ahead_theta, ss * ahead_theta]
    out(4:5, 3) = [-ss * ahead - cs * across, cs * ahead - ss * across]
    out(4:5, 7) = [cs * ct, ss * ct]
    out(4:5, 8) = [cs * st * sp - ss * cp, ss * st * sp + cs * cp]
    out(4:5, 9) = [cs * st * cp + ss * sp, ss * st * cp - cs * sp]
  end subroutine store_track_partials

  ! Fill `out` with df/dy at a sensed state, rows and columns those of the twelve; the disturbance does not enter it.
  pure subroutine rhs_jacobian(hull, body, y, out)
    type(hull_type), intent(in) :: hull
    type(body_type), intent(in) :: body
    real(dp), intent(in) :: y(10)
    real(dp), intent(out) :: out(12, 12)
    real(dp) :: list(1, ENTRIES)
    integer :: i

    call store_partials(1, 1, hull, body, y, 1.0_dp, list)
    out = 0.0_dp
    do i = 1, ENTRIES
      out(AMONG_TWELVE(ENTRY_ROW(i)), AMONG_TWELVE(ENTRY_COLUMN(i))) = list(1, i)
    end do
    call store_track_partials(y, out)
  end subroutine rhs_jacobian

end module jacobian
