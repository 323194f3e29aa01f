! The right-hand side (eqs. 1-14, 20) and its vector-Jacobian product (the integrand of eqs. 33, 35 and 36).
!
! Ten sensed states, [phi, theta, psi, Z, u, v, w, p, q, r]; `horizontal_velocity` adds X and Y where they are wanted.
module dynamics
  use elementary, only: sincos
  use hydrodynamics, only: bearing_of, flow_along, load_of, to_body, viscous_vjp, bearing_type, flow_type, load_type
  use parameters, only: dp, hull_type, body_type, GRAVITY
  implicit none
  private
  public :: momenta, geometry_of, rates, rates_at, rates_vjp, horizontal_velocity, attitude_type, geometry_type

  ! Sines and cosines of roll and pitch.
  type :: attitude_type
    real(dp) :: sp, cp, st, ct
  end type attitude_type

  ! What is costly in the rates and used again by their transpose: the attitude and the flow's bearing.
  type :: geometry_type
    type(attitude_type) :: attitude
    type(bearing_type) :: bearing
  end type geometry_type

contains

  ! Linear and angular momentum P and Pi of eq. 9, body frame.
  pure subroutine momenta(hull, body, u, v, w, p, q, r, Pu, Pv, Pw, Lp, Lq, Lr)
    type(hull_type), intent(in) :: hull
    type(body_type), intent(in) :: body
    real(dp), intent(in) :: u, v, w, p, q, r
    real(dp), intent(out) :: Pu, Pv, Pw, Lp, Lq, Lr

    Pu = hull%mass_u * u + q * body%Sz - r * body%Sy
    Pv = hull%mass_v * v + r * body%Sx - p * body%Sz
    Pw = hull%mass_w * w + p * body%Sy - q * body%Sx
    Lp = (hull%added_p + body%Jxx) * p + body%Jxy * q + body%Jxz * r + body%Sy * w - body%Sz * v
    Lq = body%Jxy * p + (hull%added_q + body%Jyy) * q + body%Jyz * r + body%Sz * u - body%Sx * w
    Lr = body%Jxz * p + body%Jyz * q + (hull%added_r + body%Jzz) * r + body%Sx * v - body%Sy * u
  end subroutine momenta

  ! Attitude and bearing of a state.
  pure function geometry_of(y) result(geometry)
    real(dp), intent(in) :: y(10)
    type(geometry_type) :: geometry

    call sincos(y(1), geometry%attitude%sp, geometry%attitude%cp)
    call sincos(y(2), geometry%attitude%st, geometry%attitude%ct)
    geometry%bearing = bearing_of(y(5), y(6), y(7))
  end function geometry_of

  ! Time derivatives of the ten sensed states under disturbance b (N, N m).
  pure function rates(hull, body, y, b) result(d)
    type(hull_type), intent(in) :: hull
    type(body_type), intent(in) :: body
    real(dp), intent(in) :: y(10), b(6)
    real(dp) :: d(10)

    d = rates_at(hull, body, y, geometry_of(y), b)
  end function rates

  ! `rates` where the state's geometry is known.
  pure function rates_at(hull, body, y, geometry, b) result(d)
    type(hull_type), intent(in) :: hull
    type(body_type), intent(in) :: body
    type(geometry_type), intent(in) :: geometry
    real(dp), intent(in) :: y(10), b(6)
    real(dp) :: d(10)
    type(flow_type) :: flow
    type(load_type) :: load
    real(dp) :: Z, u, v, w, p, q, r, sp, cp, st, ct, kx, ky, kz, gx, gy, gz, buoyancy, turn, inv_ct
    real(dp) :: Fx, Fy, Fz, Mx, My, Mz, Pu, Pv, Pw, Lp, Lq, Lr

    Z = y(4)
    u = y(5)
    v = y(6)
    w = y(7)
    p = y(8)
    q = y(9)
    r = y(10)
    sp = geometry%attitude%sp
    cp = geometry%attitude%cp
    st = geometry%attitude%st
    ct = geometry%attitude%ct
    kx = -st
    ky = sp * ct
    kz = cp * ct
    flow = flow_along(geometry%bearing, u, v, w)
    load = load_of(hull, body%rudder, flow, p, q, r)
    call to_body(flow, load%f1, load%f2, load%f3, Fx, Fy, Fz)
    call to_body(flow, load%m1, load%m2, load%m3, Mx, My, Mz)
    call momenta(hull, body, u, v, w, p, q, r, Pu, Pv, Pw, Lp, Lq, Lr)
    buoyancy = body%net_weight - hull%depth_slope * Z
    gx = GRAVITY * kx
    gy = GRAVITY * ky
    gz = GRAVITY * kz
    turn = sp * q + cp * r
    inv_ct = 1.0_dp / ct
    d(1) = p + st * inv_ct * turn
    d(2) = cp * q - sp * r
    d(3) = turn * inv_ct
    d(4) = kx * u + ky * v + kz * w
    d(5) = (Pv * r - Pw * q + buoyancy * kx + Fx + b(1)) / hull%mass_u
    d(6) = (Pw * p - Pu * r + buoyancy * ky + Fy + b(2)) / hull%mass_v
    d(7) = (Pu * q - Pv * p + buoyancy * kz + Fz + b(3)) / hull%mass_w
    d(8) = (Lq * r - Lr * q + Pv * w - Pw * v + body%Sy * gz - body%Sz * gy + Mx + b(4)) / hull%inertia_p
    d(9) = (Lr * p - Lp * r + Pw * u - Pu * w + body%Sz * gx - body%Sx * gz + My + b(5)) / hull%inertia_q
    d(10) = (Lp * q - Lq * p + Pu * v - Pv * u + body%Sx * gy - body%Sy * gx + Mz + b(6)) / hull%inertia_r
  end function rates_at

  ! Transpose of the derivative of `rates` applied to a (ten): by the states (ten) and by the disturbance (six).
  pure subroutine rates_vjp(hull, body, y, geometry, a, by_state, by_disturbance)
    type(hull_type), intent(in) :: hull
    type(body_type), intent(in) :: body
    type(geometry_type), intent(in) :: geometry
    real(dp), intent(in) :: y(10), a(10)
    real(dp), intent(out) :: by_state(10), by_disturbance(6)
    type(flow_type) :: flow
    type(load_type) :: load
    real(dp) :: Z, u, v, w, p, q, r, a_phi, a_theta, a_psi, a_Z, sp, cp, st, ct, kx, ky, kz
    real(dp) :: Sx, Sy, Sz, Pu, Pv, Pw, Lp, Lq, Lr, fx, fy, fz, mx, my, mz
    real(dp) :: d_u, d_v, d_w, d_p, d_q, d_r, e_Pu, e_Pv, e_Pw, e_Lp, e_Lq, e_Lr
    real(dp) :: buoyancy, e_kx, e_ky, e_kz, inv_ct, tt, turn, nod, e_turn

    Z = y(4)
    u = y(5)
    v = y(6)
    w = y(7)
    p = y(8)
    q = y(9)
    r = y(10)
    a_phi = a(1)
    a_theta = a(2)
    a_psi = a(3)
    a_Z = a(4)
    sp = geometry%attitude%sp
    cp = geometry%attitude%cp
    st = geometry%attitude%st
    ct = geometry%attitude%ct
    kx = -st
    ky = sp * ct
    kz = cp * ct
    flow = flow_along(geometry%bearing, u, v, w)
    load = load_of(hull, body%rudder, flow, p, q, r)
    call momenta(hull, body, u, v, w, p, q, r, Pu, Pv, Pw, Lp, Lq, Lr)
    Sx = body%Sx
    Sy = body%Sy
    Sz = body%Sz
    fx = a(5) / hull%mass_u
    fy = a(6) / hull%mass_v
    fz = a(7) / hull%mass_w
    mx = a(8) / hull%inertia_p
    my = a(9) / hull%inertia_q
    mz = a(10) / hull%inertia_r

    call viscous_vjp(hull, body%rudder, u, v, w, p, q, r, flow, load, fx, fy, fz, mx, my, mz, d_u, d_v, d_w, d_p, d_q, d_r)

    ! Triple products: a.(P x Omega) and a.(Pi x Omega) by P, Pi and Omega; a.(P x V) by P and V.
    e_Pu = q * fz - r * fy + v * mz - w * my
    e_Pv = r * fx - p * fz + w * mx - u * mz
    e_Pw = p * fy - q * fx + u * my - v * mx
    e_Lp = q * mz - r * my
    e_Lq = r * mx - p * mz
    e_Lr = p * my - q * mx
    d_p = d_p + (fy * Pw - fz * Pv + my * Lr - mz * Lq)
    d_q = d_q + (fz * Pu - fx * Pw + mz * Lp - mx * Lr)
    d_r = d_r + (fx * Pv - fy * Pu + mx * Lq - my * Lp)
    d_u = d_u + (my * Pw - mz * Pv)
    d_v = d_v + (mz * Pu - mx * Pw)
    d_w = d_w + (mx * Pv - my * Pu)
    ! Momenta by velocities: P = mass V + Omega x S, Pi = (I_f + J_S) Omega + S x V.
    d_u = d_u + (hull%mass_u * e_Pu + e_Lq * Sz - e_Lr * Sy)
    d_v = d_v + (hull%mass_v * e_Pv + e_Lr * Sx - e_Lp * Sz)
    d_w = d_w + (hull%mass_w * e_Pw + e_Lp * Sy - e_Lq * Sx)
    d_p = d_p + (Sy * e_Pw - Sz * e_Pv + (hull%added_p + body%Jxx) * e_Lp + body%Jxy * e_Lq + body%Jxz * e_Lr)
    d_q = d_q + (Sz * e_Pu - Sx * e_Pw + body%Jxy * e_Lp + (hull%added_q + body%Jyy) * e_Lq + body%Jyz * e_Lr)
    d_r = d_r + (Sx * e_Pv - Sy * e_Pu + body%Jxz * e_Lp + body%Jyz * e_Lq + (hull%added_r + body%Jzz) * e_Lr)
    ! Gravity's direction k: buoyancy, the weight's moment and the depth rate k.V.
    buoyancy = body%net_weight - hull%depth_slope * Z
    e_kx = buoyancy * fx + GRAVITY * (my * Sz - mz * Sy) + a_Z * u
    e_ky = buoyancy * fy + GRAVITY * (mz * Sx - mx * Sz) + a_Z * v
    e_kz = buoyancy * fz + GRAVITY * (mx * Sy - my * Sx) + a_Z * w
    d_u = d_u + a_Z * kx
    d_v = d_v + a_Z * ky
    d_w = d_w + a_Z * kz
    ! Kinematics (eq. 4).
    inv_ct = 1.0_dp / ct
    tt = st * inv_ct
    turn = sp * q + cp * r
    nod = cp * q - sp * r
    e_turn = a_phi * tt + a_psi * inv_ct
    d_p = d_p + a_phi
    d_q = d_q + (e_turn * sp + a_theta * cp)
    d_r = d_r + (e_turn * cp - a_theta * sp)
    by_state(1) = e_turn * nod - a_theta * turn + e_ky * kz - e_kz * ky
    by_state(2) = (a_phi * inv_ct + a_psi * tt) * inv_ct * turn - ct * e_kx - st * (sp * e_ky + cp * e_kz)
    by_state(3) = 0.0_dp
    by_state(4) = -hull%depth_slope * (fx * kx + fy * ky + fz * kz)
    by_state(5) = d_u
    by_state(6) = d_v
    by_state(7) = d_w
    by_state(8) = d_p
    by_state(9) = d_q
    by_state(10) = d_r
    by_disturbance(1) = fx
    by_disturbance(2) = fy
    by_disturbance(3) = fz
    by_disturbance(4) = mx
    by_disturbance(5) = my
    by_disturbance(6) = mz
  end subroutine rates_vjp

  ! Rates of X and Y (rows 1 and 2 of eq. 3 times the velocity) from the ten sensed states.
  pure subroutine horizontal_velocity(y, north, east)
    real(dp), intent(in) :: y(10)
    real(dp), intent(out) :: north, east
    real(dp) :: sp, cp, st, ct, ss, cs, ahead, across

    call sincos(y(1), sp, cp)
    call sincos(y(2), st, ct)
    call sincos(y(3), ss, cs)
    ahead = ct * y(5) + st * (sp * y(6) + cp * y(7))
    across = cp * y(6) - sp * y(7)
    north = cs * ahead - ss * across
    east = ss * ahead + cs * across
  end subroutine horizontal_velocity

end module dynamics
