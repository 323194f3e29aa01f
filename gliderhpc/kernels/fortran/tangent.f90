! The filter's Runge-Kutta step (eqs. 19, 21) and its exact tangent (the matrix of eq. 24), applied from the end of a block
! of steps to its beginning. One profile in each lane.
module tangent
  use dynamics, only: rates, horizontal_velocity
  use jacobian, only: store_partials, pulled, ENTRIES
  use parameters, only: dp, hull_type, body_type, load_hull, load_body, HULL_SIZE, BODY_SIZE
  use window, only: LANES
  implicit none
  private
  public :: advance, pull_back

contains

  ! Step k of a block: from row k of `path` to the next, the stages' Jacobians left in `partials`.
  !
  ! A row of `path` holds the sensed states, the disturbances, X and Y. A step of no length leaves every bit unchanged.
  subroutine advance(m, hull, bodies, durations, decay, path, partials, k)
    integer, intent(in) :: m, k
    real(dp), intent(in) :: hull(LANES, HULL_SIZE), bodies(LANES, BODY_SIZE, m), durations(LANES, m), decay(LANES, 6)
    real(dp), intent(inout) :: path(LANES, 18, m + 1), partials(LANES, ENTRIES, 4, m)
    integer :: lane

    !$omp simd
    do lane = 1, LANES
      call advance_lane(lane, hull, bodies(:, :, k), durations(:, k), decay, path(:, :, k), path(:, :, k + 1), &
        partials(:, :, :, k))
    end do
  end subroutine advance

  pure subroutine advance_lane(lane, hull, bodies, durations, decay, before, behind, partials)
    integer, intent(in) :: lane
    real(dp), intent(in) :: hull(LANES, HULL_SIZE), bodies(LANES, BODY_SIZE), durations(LANES), decay(LANES, 6)
    real(dp), intent(in) :: before(LANES, 18)
    real(dp), intent(inout) :: behind(LANES, 18), partials(LANES, ENTRIES, 4)
    type(hull_type) :: constants
    type(body_type) :: body
    real(dp) :: h, y(10), b(6), stage(10), rate(10), total(10), north, east
    logical :: moves

    constants = load_hull(LANES, hull, lane)
    body = load_body(LANES, bodies, lane)
    h = durations(lane)
    y = before(lane, 1:10)
    b = before(lane, 11:16)
    north = 0.0_dp
    east = 0.0_dp
    total = 0.0_dp * y
    stage = y
    call add_stage(lane, constants, body, stage, b, h, 1.0_dp, partials(:, :, 1), rate, total, north, east)
    stage = y + 0.5_dp * h * rate
    call add_stage(lane, constants, body, stage, b, 0.5_dp * h, 2.0_dp, partials(:, :, 2), rate, total, north, east)
    stage = y + 0.5_dp * h * rate
    call add_stage(lane, constants, body, stage, b, 0.5_dp * h, 2.0_dp, partials(:, :, 3), rate, total, north, east)
    stage = y + h * rate
    call add_stage(lane, constants, body, stage, b, h, 1.0_dp, partials(:, :, 4), rate, total, north, east)
    moves = h > 0.0_dp
    ! Summed first, so that a depth of hundreds of metres is rounded once a step.
    behind(lane, 1:10) = merge(y + h / 6.0_dp * total, y, moves)
    behind(lane, 11:16) = merge(decay(lane, :), 1.0_dp, moves) * b
    behind(lane, 17) = merge(before(lane, 17) + h / 6.0_dp * north, before(lane, 17), moves)
    behind(lane, 18) = merge(before(lane, 18) + h / 6.0_dp * east, before(lane, 18), moves)
  end subroutine advance_lane

  ! A stage's rates, added with their weight; its Jacobian, times `scale`, into `partials`.
  pure subroutine add_stage(lane, hull, body, stage, b, scale, weight, partials, rate, total, north, east)
    integer, intent(in) :: lane
    type(hull_type), intent(in) :: hull
    type(body_type), intent(in) :: body
    real(dp), intent(in) :: stage(10), b(6), scale, weight
    real(dp), intent(inout) :: partials(LANES, ENTRIES), total(10), north, east
    real(dp), intent(out) :: rate(10)
    real(dp) :: to_north, to_east

    call store_partials(LANES, lane, hull, body, stage, scale, partials)
    rate = rates(hull, body, stage, b)
    call horizontal_velocity(stage, to_north, to_east)
    total = total + weight * rate
    north = north + weight * to_north
    east = east + weight * to_east
  end subroutine add_stage

  ! Multiply `transition` (rows of 16) from the right by the tangent of step k (eq. 24's matrix).
  !
  ! Its ten rows are costates of the sensed states at the end of the block; its columns the sensed states and the
  ! disturbances. With a the costate behind the step, the stages' costates are h/6 times n4 = a, n3 = 2a + f4,
  ! n2 = 2a + f3, n1 = a + f2, where f4 = (h J4)' n4, f3 = (h/2 J3)' n3, f2 = (h/2 J2)' n2 and f1 = (h J1)' n1; the
  ! costate before it is a + (f1 + 2 f2 + 2 f3 + f4) / 6.
  subroutine pull_back(m, hull, durations, decay, partials, transition, k)
    integer, intent(in) :: m, k
    real(dp), intent(in) :: hull(LANES, HULL_SIZE), durations(LANES, m), decay(LANES, 6)
    real(dp), intent(in) :: partials(LANES, ENTRIES, 4, m)
    real(dp), intent(inout) :: transition(LANES, 16, 10)
    integer :: row, lane

    do row = 1, 10
      !$omp simd
      do lane = 1, LANES
        call pull_back_lane(lane, hull, durations(:, k), decay, partials(:, :, :, k), transition(:, :, row))
      end do
    end do
  end subroutine pull_back

  pure subroutine pull_back_lane(lane, hull, durations, decay, partials, transition)
    integer, intent(in) :: lane
    real(dp), intent(in) :: hull(LANES, HULL_SIZE), durations(LANES), decay(LANES, 6), partials(LANES, ENTRIES, 4)
    real(dp), intent(inout) :: transition(LANES, 16)
    real(dp) :: h, a(10), n1(10), n2(10), n3(10), f1(10), f2(10), f3(10), f4(10)

    h = durations(lane)
    a = transition(lane, 1:10)
    f4 = pulled(LANES, lane, partials(:, :, 4), a)
    n3 = f4 + 2.0_dp * a
    f3 = pulled(LANES, lane, partials(:, :, 3), n3)
    n2 = f3 + 2.0_dp * a
    f2 = pulled(LANES, lane, partials(:, :, 2), n2)
    n1 = f2 + a
    f1 = pulled(LANES, lane, partials(:, :, 1), n1)
    transition(lane, 1:10) = a + 1.0_dp / 6.0_dp * ((f1 + f4) + 2.0_dp * (f2 + f3))
    transition(lane, 11:16) = transition(lane, 11:16) * merge(decay(lane, :), 1.0_dp, h > 0.0_dp) &
      + h / 6.0_dp / hull(lane, 1:6) * (a(5:10) + n3(5:10) + n2(5:10) + n1(5:10))
  end subroutine pull_back_lane

end module tangent
