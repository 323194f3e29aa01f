! Forward runs, and the cost of windows with its gradient: eq. 28 over samples 1..n and its exact discrete adjoint (the
! counterpart of eqs. 33-36), terminal costate zero (eq. 34). One window in each lane, LANES of them side by side.
!
! Arrays are those of Python's `Problem`, axes reversed: the lane is the first index. Every step has its own length, so
! that a window shorter than its neighbours ends in steps of no duration.
module window
  use dynamics, only: attitude_type, geometry_type
  use elementary, only: wrap
  use hydrodynamics, only: bearing_type
  use parameters, only: dp, hull_type, load_hull, load_body, HULL_SIZE, BODY_SIZE
  use rk4, only: step, step_vjp, displacement, stages_type
  implicit none
  private
  public :: cost_and_gradient, simulate

  ! Profiles side by side: set when the library is built.
  integer, parameter, public :: LANES = GLIDERHPC_LANES
  ! Numbers a step that the adjoint needs besides the states: three later stages of ten, and the geometry of all four.
  integer, parameter, public :: TAPE_SIZE = 62

contains

  ! Leave the cost of each window in `cost`, its gradient in `gradient` and `gradient_state0`.
  subroutine cost_and_gradient(n, hull, bodies, state0, b, measurements, weights, h, states, tape, gradient, &
      gradient_state0, cost)
    integer, intent(in) :: n
    real(dp), intent(in) :: hull(LANES, HULL_SIZE), bodies(LANES, BODY_SIZE, n), state0(LANES, 10), b(LANES, 6, n)
    real(dp), intent(in) :: measurements(LANES, 4, 0:n), weights(LANES, 0:n), h(LANES, n)
    real(dp), intent(inout) :: states(LANES, 10, 0:n), tape(LANES, TAPE_SIZE, n)
    real(dp), intent(out) :: gradient(LANES, 6, n), gradient_state0(LANES, 10), cost(LANES)

    call forward(n, hull, bodies, state0, b, h, states, tape)
    call adjoint(n, hull, bodies, states, tape, measurements, weights, h, gradient, gradient_state0, cost)
  end subroutine cost_and_gradient

  ! Integrate the sensed states: fill `states` and what the adjoint needs, `tape`.
  subroutine forward(n, hull, bodies, state0, b, h, states, tape)
    integer, intent(in) :: n
    real(dp), intent(in) :: hull(LANES, HULL_SIZE), bodies(LANES, BODY_SIZE, n), state0(LANES, 10), b(LANES, 6, n)
    real(dp), intent(in) :: h(LANES, n)
    real(dp), intent(inout) :: states(LANES, 10, 0:n), tape(LANES, TAPE_SIZE, n)
    integer :: k, lane

    states(:, :, 0) = state0
    do k = 1, n
      !$omp simd
      do lane = 1, LANES
        call step_in_lane(lane, hull, bodies(:, :, k), states(:, :, k - 1), b(:, :, k), h(:, k), states(:, :, k), &
          tape(:, :, k))
      end do
    end do
  end subroutine forward

  ! Sweep the exact transpose backwards; on the way the cost is summed, radians and metres squared, seconds.
  subroutine adjoint(n, hull, bodies, states, tape, measurements, weights, h, gradient, gradient_state0, cost)
    integer, intent(in) :: n
    real(dp), intent(in) :: hull(LANES, HULL_SIZE), bodies(LANES, BODY_SIZE, n), states(LANES, 10, 0:n)
    real(dp), intent(in) :: tape(LANES, TAPE_SIZE, n), measurements(LANES, 4, 0:n), weights(LANES, 0:n), h(LANES, n)
    real(dp), intent(out) :: gradient(LANES, 6, n), gradient_state0(LANES, 10), cost(LANES)
    integer :: k, lane

    cost = 0.0_dp
    gradient_state0 = 0.0_dp
    do k = n, 1, -1
      !$omp simd
      do lane = 1, LANES
        call step_back_in_lane(lane, hull, bodies(:, :, k), states(:, :, k - 1), tape(:, :, k), states(:, :, k), &
          measurements(:, :, k), weights(:, k), h(:, k), gradient(:, :, k), gradient_state0, cost)
      end do
    end do
  end subroutine adjoint

  ! One step of one lane: the state behind it, its later stages and its geometry.
  pure subroutine step_in_lane(lane, hull, bodies, before, b, h, behind, tape)
    integer, intent(in) :: lane
    real(dp), intent(in) :: hull(LANES, HULL_SIZE), bodies(LANES, BODY_SIZE), before(LANES, 10), b(LANES, 6), h(LANES)
    real(dp), intent(inout) :: behind(LANES, 10), tape(LANES, TAPE_SIZE)
    type(stages_type) :: stages
    real(dp) :: new(10)

    call step(load_hull(LANES, hull, lane), load_body(LANES, bodies, lane), before(lane, :), b(lane, :), h(lane), new, stages)
    behind(lane, :) = new
    tape(lane, 1:10) = stages%y2
    tape(lane, 11:20) = stages%y3
    tape(lane, 21:30) = stages%y4
    call record_geometry(lane, stages%g1, tape(:, 31:38))
    call record_geometry(lane, stages%g2, tape(:, 39:46))
    call record_geometry(lane, stages%g3, tape(:, 47:54))
    call record_geometry(lane, stages%g4, tape(:, 55:62))
  end subroutine step_in_lane

  ! One step of one lane backwards: `costate` is that behind the step, then that before it.
  pure subroutine step_back_in_lane(lane, hull, bodies, before, tape, behind, measured, weights, h, gradient, costate, cost)
    integer, intent(in) :: lane
    real(dp), intent(in) :: hull(LANES, HULL_SIZE), bodies(LANES, BODY_SIZE), before(LANES, 10), tape(LANES, TAPE_SIZE)
    real(dp), intent(in) :: behind(LANES, 10), measured(LANES, 4), weights(LANES), h(LANES)
    real(dp), intent(inout) :: gradient(LANES, 6), costate(LANES, 10), cost(LANES)
    type(stages_type) :: stages
    real(dp) :: d_phi, d_theta, d_psi, d_Z, weight, scale, a(10), by_state(10), by_disturbance(6)

    ! What the model lacks of the sample: roll, pitch, heading (the short way round) and depth.
    d_phi = behind(lane, 1) - measured(lane, 1)
    d_theta = behind(lane, 2) - measured(lane, 2)
    d_psi = wrap(behind(lane, 3) - measured(lane, 3))
    d_Z = behind(lane, 4) - measured(lane, 4)
    weight = h(lane) * weights(lane)
    cost(lane) = cost(lane) + weight * (d_phi * d_phi + d_theta * d_theta + d_psi * d_psi + d_Z * d_Z)
    scale = 2.0_dp * weight
    a = costate(lane, :)
    a(1) = a(1) + scale * d_phi
    a(2) = a(2) + scale * d_theta
    a(3) = a(3) + scale * d_psi
    a(4) = a(4) + scale * d_Z
    stages%y1 = before(lane, :)
    stages%y2 = tape(lane, 1:10)
    stages%y3 = tape(lane, 11:20)
    stages%y4 = tape(lane, 21:30)
    stages%g1 = load_geometry(lane, tape(:, 31:38))
    stages%g2 = load_geometry(lane, tape(:, 39:46))
    stages%g3 = load_geometry(lane, tape(:, 47:54))
    stages%g4 = load_geometry(lane, tape(:, 55:62))
    call step_vjp(load_hull(LANES, hull, lane), load_body(LANES, bodies, lane), stages, a, h(lane), by_state, by_disturbance)
    costate(lane, :) = by_state
    gradient(lane, :) = by_disturbance
  end subroutine step_back_in_lane

  ! Write the eight numbers of a stage's geometry.
  pure subroutine record_geometry(lane, geometry, tape)
    integer, intent(in) :: lane
    type(geometry_type), intent(in) :: geometry
    real(dp), intent(inout) :: tape(LANES, 8)

    tape(lane, 1) = geometry%attitude%sp
    tape(lane, 2) = geometry%attitude%cp
    tape(lane, 3) = geometry%attitude%st
    tape(lane, 4) = geometry%attitude%ct
    tape(lane, 5) = geometry%bearing%alpha
    tape(lane, 6) = geometry%bearing%beta
    tape(lane, 7) = geometry%bearing%inv_U
    tape(lane, 8) = geometry%bearing%inv_V
  end subroutine record_geometry

  ! Read them again.
  pure function load_geometry(lane, tape) result(geometry)
    integer, intent(in) :: lane
    real(dp), intent(in) :: tape(LANES, 8)
    type(geometry_type) :: geometry

    geometry%attitude = attitude_type(tape(lane, 1), tape(lane, 2), tape(lane, 3), tape(lane, 4))
    geometry%bearing = bearing_type(tape(lane, 5), tape(lane, 6), tape(lane, 7), tape(lane, 8))
  end function load_geometry

  ! Fill `trajectory` (twelve states) from `state0` under bodies and disturbances: one glider, no lanes.
  subroutine simulate(n, hull, bodies, state0, b, h, trajectory)
    integer, intent(in) :: n
    real(dp), intent(in) :: hull(1, HULL_SIZE), bodies(1, BODY_SIZE, n), state0(12), b(6, n), h
    real(dp), intent(out) :: trajectory(12, 0:n)
    type(hull_type) :: constants
    type(stages_type) :: stages
    real(dp) :: y(10), new(10), north, east
    integer :: k

    constants = load_hull(1, hull, 1)
    y = [state0(1:3), state0(6:12)]
    trajectory(:, 0) = state0
    do k = 1, n
      call step(constants, load_body(1, bodies(:, :, k), 1), y, b(:, k), h, new, stages)
      call displacement(stages, h, north, east)
      y = new
      trajectory(:, k) = [y(1:3), trajectory(4, k - 1) + north, trajectory(5, k - 1) + east, y(4:10)]
    end do
  end subroutine simulate

end module window
