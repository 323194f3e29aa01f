! What the shared library exports, by C's rules: entry points, and the handshake that says what was built.
!
! No equations of its own; those of the modules that it takes in. All stand in one compilation, so that every formula
! dissolves into the loop over lanes that calls it. The build defines GLIDERHPC_LANES,
! GLIDERHPC_SOURCES and GLIDERHPC_FLAGS.
#include "parameters.f90"
#include "elementary.f90"
#include "hydrodynamics.f90"
#include "dynamics.f90"
#include "rk4.f90"
#include "window.f90"
#include "jacobian.f90"
#include "tangent.f90"

module library
  use, intrinsic :: iso_fortran_env, only: compiler_version
  use, intrinsic :: iso_c_binding, only: c_char, c_f_pointer, c_int64_t, c_null_char, c_ptr
  use dynamics, only: geometry_of, horizontal_velocity, rates, rates_vjp
  use elementary, only: arctan2, sincos, wrap
  use jacobian, only: rhs_jacobian, ENTRIES
  use parameters, only: dp, load_body, load_hull, BODY_SIZE, HULL_SIZE
  use rk4, only: step, step_vjp, stages_type
  use tangent, only: advance, pull_back
  use window, only: cost_and_gradient, simulate, TAPE_SIZE, LANES
  implicit none
  private

  ! Of the entry points and the layout of what they take; to be raised with every change of either.
  integer(c_int64_t), parameter :: INTERFACE_VERSION = 1

#if defined(__AVX512F__)
  integer(c_int64_t), parameter :: VECTOR_DOUBLES = 8
#elif defined(__AVX2__)
  integer(c_int64_t), parameter :: VECTOR_DOUBLES = 4
#else
  integer(c_int64_t), parameter :: VECTOR_DOUBLES = 2
#endif

  ! The handshake is data, so that it can be read where this library's instructions are unknown to the processor.
  !
  ! Layout: version, lanes, sizes of a hull, a body, what a step keeps and a Jacobian; doubles in the widest vector used.
  integer(c_int64_t), public, bind(c, name="gliderhpc_layout") :: layout(7) = [INTERFACE_VERSION, int(LANES, c_int64_t), &
    int(HULL_SIZE, c_int64_t), int(BODY_SIZE, c_int64_t), int(TAPE_SIZE, c_int64_t), int(ENTRIES, c_int64_t), VECTOR_DOUBLES]

  ! What it was built from and by: digest of the sources, compiler, flags, a line each; a C string.
  character(len=*), parameter :: TOLD = GLIDERHPC_SOURCES // new_line("a") // compiler_version() // new_line("a") &
    // GLIDERHPC_FLAGS // c_null_char
  character(kind=c_char), public, bind(c, name="gliderhpc_built_from") :: built_from(len(TOLD)) = &
    transfer(TOLD, c_null_char, len(TOLD))

  ! Python's `Problem`: steps, then the address of each array.
  type, bind(c) :: problem_type
    integer(c_int64_t) :: steps
    type(c_ptr) :: hull, bodies, state0, trial, measurements, weights, durations, states, tape
    type(c_ptr) :: gradient, gradient_state0, cost
  end type problem_type

contains

  ! Sine and cosine of n angles.
  subroutine c_sincos(n, x, sine, cosine) bind(c, name="gliderhpc_sincos")
    integer(c_int64_t), intent(in), value :: n
    real(dp), intent(in) :: x(n)
    real(dp), intent(out) :: sine(n), cosine(n)

    call sincos(x, sine, cosine)
  end subroutine c_sincos

  ! Angles of n points.
  subroutine c_arctan2(n, y, x, angle) bind(c, name="gliderhpc_arctan2")
    integer(c_int64_t), intent(in), value :: n
    real(dp), intent(in) :: y(n), x(n)
    real(dp), intent(out) :: angle(n)

    angle = arctan2(y, x)
  end subroutine c_arctan2

  ! n angles within half a turn of zero.
  subroutine c_wrap(n, x, wrapped) bind(c, name="gliderhpc_wrap")
    integer(c_int64_t), intent(in), value :: n
    real(dp), intent(in) :: x(n)
    real(dp), intent(out) :: wrapped(n)

    wrapped = wrap(x)
  end subroutine c_wrap

  ! Rates of the twelve states.
  subroutine c_rhs(hull, body, state, b, out) bind(c, name="gliderhpc_rhs")
    real(dp), intent(in) :: hull(1, HULL_SIZE), body(1, BODY_SIZE), state(12), b(6)
    real(dp), intent(out) :: out(12)
    real(dp) :: y(10), d(10)

    y = sensed_of(state)
    d = rates(load_hull(1, hull, 1), load_body(1, body, 1), y, b)
    out = [d(1:3), 0.0_dp, 0.0_dp, d(4:10)]
    call horizontal_velocity(y, out(4), out(5))
  end subroutine c_rhs

  ! Transpose of the sensed rates' derivative applied to a.
  subroutine c_rates_vjp(hull, body, y, a, by_state, by_disturbance) bind(c, name="gliderhpc_rates_vjp")
    real(dp), intent(in) :: hull(1, HULL_SIZE), body(1, BODY_SIZE), y(10), a(10)
    real(dp), intent(out) :: by_state(10), by_disturbance(6)

    call rates_vjp(load_hull(1, hull, 1), load_body(1, body, 1), y, geometry_of(y), a, by_state, by_disturbance)
  end subroutine c_rates_vjp

  ! df/dy of the twelve states, row by row as C has it.
  subroutine c_rhs_jacobian(hull, body, state, out) bind(c, name="gliderhpc_rhs_jacobian")
    real(dp), intent(in) :: hull(1, HULL_SIZE), body(1, BODY_SIZE), state(12)
    real(dp), intent(out) :: out(12, 12)
    real(dp) :: columns(12, 12)

    call rhs_jacobian(load_hull(1, hull, 1), load_body(1, body, 1), sensed_of(state), columns)
    out = transpose(columns)
  end subroutine c_rhs_jacobian

  ! One Runge-Kutta step of the sensed states.
  subroutine c_step(hull, body, y, b, h, new) bind(c, name="gliderhpc_step")
    real(dp), intent(in) :: hull(1, HULL_SIZE), body(1, BODY_SIZE), y(10), b(6)
    real(dp), intent(in), value :: h
    real(dp), intent(out) :: new(10)
    type(stages_type) :: stages

    call step(load_hull(1, hull, 1), load_body(1, body, 1), y, b, h, new, stages)
  end subroutine c_step

  ! Transpose of its derivative applied to a.
  subroutine c_step_vjp(hull, body, y, b, a, h, by_state, by_disturbance) bind(c, name="gliderhpc_step_vjp")
    real(dp), intent(in) :: hull(1, HULL_SIZE), body(1, BODY_SIZE), y(10), b(6), a(10)
    real(dp), intent(in), value :: h
    real(dp), intent(out) :: by_state(10), by_disturbance(6)
    type(stages_type) :: stages
    real(dp) :: new(10)

    call step(load_hull(1, hull, 1), load_body(1, body, 1), y, b, h, new, stages)
    call step_vjp(load_hull(1, hull, 1), load_body(1, body, 1), stages, a, h, by_state, by_disturbance)
  end subroutine c_step_vjp

  ! Trajectory of the twelve states under n disturbances.
  subroutine c_simulate(n, hull, bodies, state0, b, h, trajectory) bind(c, name="gliderhpc_simulate")
    integer(c_int64_t), intent(in), value :: n
    real(dp), intent(in) :: hull(1, HULL_SIZE), bodies(1, BODY_SIZE, n), state0(12), b(6, n)
    real(dp), intent(in), value :: h
    real(dp), intent(out) :: trajectory(12, 0:n)

    call simulate(int(n), hull, bodies, state0, b, h, trajectory)
  end subroutine c_simulate

  ! Cost and gradient of a batch of windows, one in each lane.
  subroutine c_cost_and_gradient(problem) bind(c, name="gliderhpc_cost_and_gradient")
    type(problem_type), intent(in) :: problem
    real(dp), pointer, contiguous, dimension(:) :: hull, bodies, state0, trial, measurements, weights, durations
    real(dp), pointer, contiguous, dimension(:) :: states, tape, gradient, gradient_state0, cost
    integer :: n

    n = int(problem%steps)
    call c_f_pointer(problem%hull, hull, [LANES * HULL_SIZE])
    call c_f_pointer(problem%bodies, bodies, [LANES * BODY_SIZE * n])
    call c_f_pointer(problem%state0, state0, [LANES * 10])
    call c_f_pointer(problem%trial, trial, [LANES * 6 * n])
    call c_f_pointer(problem%measurements, measurements, [LANES * 4 * (n + 1)])
    call c_f_pointer(problem%weights, weights, [LANES * (n + 1)])
    call c_f_pointer(problem%durations, durations, [LANES * n])
    call c_f_pointer(problem%states, states, [LANES * 10 * (n + 1)])
    call c_f_pointer(problem%tape, tape, [LANES * TAPE_SIZE * n])
    call c_f_pointer(problem%gradient, gradient, [LANES * 6 * n])
    call c_f_pointer(problem%gradient_state0, gradient_state0, [LANES * 10])
    call c_f_pointer(problem%cost, cost, [LANES])
    call cost_and_gradient(n, hull, bodies, state0, trial, measurements, weights, durations, states, tape, gradient, &
      gradient_state0, cost)
  end subroutine c_cost_and_gradient

  ! Step k (from 0) of a block of m, one profile in each lane.
  subroutine c_advance(m, hull, bodies, durations, decay, path, partials, k) bind(c, name="gliderhpc_advance")
    integer(c_int64_t), intent(in), value :: m, k
    real(dp), intent(in) :: hull(LANES, HULL_SIZE), bodies(LANES, BODY_SIZE, m), durations(LANES, m), decay(LANES, 6)
    real(dp), intent(inout) :: path(LANES, 18, m + 1), partials(LANES, ENTRIES, 4, m)

    call advance(int(m), hull, bodies, durations, decay, path, partials, int(k) + 1)
  end subroutine c_advance

  ! The tangent of step k (from 0) of a block of m, applied to `transition`.
  subroutine c_pull_back(m, hull, durations, decay, partials, transition, k) bind(c, name="gliderhpc_pull_back")
    integer(c_int64_t), intent(in), value :: m, k
    real(dp), intent(in) :: hull(LANES, HULL_SIZE), durations(LANES, m), decay(LANES, 6)
    real(dp), intent(in) :: partials(LANES, ENTRIES, 4, m)
    real(dp), intent(inout) :: transition(LANES, 16, 10)

    call pull_back(int(m), hull, durations, decay, partials, transition, int(k) + 1)
  end subroutine c_pull_back

  ! The ten sensed states of a twelve-state row.
  pure function sensed_of(state) result(y)
    real(dp), intent(in) :: state(12)
    real(dp) :: y(10)

    y = [state(1:3), state(6:12)]
  end function sensed_of

end module library
