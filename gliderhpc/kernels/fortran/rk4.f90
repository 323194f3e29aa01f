! One classical Runge-Kutta step of the ten sensed states (eqs. 1-14, 20 between two samples), and its exact transpose
! (the discrete counterpart of eqs. 33-36). The disturbance is constant over the step.
module rk4
  use dynamics, only: geometry_of, horizontal_velocity, rates_at, rates_vjp, geometry_type
  use parameters, only: dp, hull_type, body_type
  implicit none
  private
  public :: step, step_vjp, displacement, advanced, stages_type

  ! The four stages' states and their geometry: what the transpose needs.
  type :: stages_type
    real(dp) :: y1(10), y2(10), y3(10), y4(10)
    type(geometry_type) :: g1, g2, g3, g4
  end type stages_type

contains

  ! y + a (k1 + 2 k2 + 2 k3 + k4), summed first so that a depth of hundreds of metres is rounded once a step.
  pure function advanced(y, a, k1, k2, k3, k4) result(new)
    real(dp), intent(in) :: y(10), a, k1(10), k2(10), k3(10), k4(10)
    real(dp) :: new(10)

    new = y + a * (k1 + 2.0_dp * (k2 + k3) + k4)
  end function advanced

  ! Advance y by h: the new state, the four stages and their geometry.
  pure subroutine step(hull, body, y, b, h, new, stages)
    type(hull_type), intent(in) :: hull
    type(body_type), intent(in) :: body
    real(dp), intent(in) :: y(10), b(6), h
    real(dp), intent(out) :: new(10)
    type(stages_type), intent(out) :: stages
    real(dp) :: k1(10), k2(10), k3(10), k4(10)

    stages%y1 = y
    stages%g1 = geometry_of(stages%y1)
    k1 = rates_at(hull, body, stages%y1, stages%g1, b)
    stages%y2 = y + 0.5_dp * h * k1
    stages%g2 = geometry_of(stages%y2)
    k2 = rates_at(hull, body, stages%y2, stages%g2, b)
    stages%y3 = y + 0.5_dp * h * k2
    stages%g3 = geometry_of(stages%y3)
    k3 = rates_at(hull, body, stages%y3, stages%g3, b)
    stages%y4 = y + h * k3
    stages%g4 = geometry_of(stages%y4)
    k4 = rates_at(hull, body, stages%y4, stages%g4, b)
    new = advanced(y, h / 6.0_dp, k1, k2, k3, k4)
  end subroutine step

  ! Transpose of the derivative of `step` applied to a (ten): by the state and by the disturbance.
  pure subroutine step_vjp(hull, body, stages, a, h, by_state, by_disturbance)
    type(hull_type), intent(in) :: hull
    type(body_type), intent(in) :: body
    type(stages_type), intent(in) :: stages
    real(dp), intent(in) :: a(10), h
    real(dp), intent(out) :: by_state(10), by_disturbance(6)
    real(dp) :: e1(10), e2(10), e3(10), e4(10), b1(6), b2(6), b3(6), b4(6)

    call rates_vjp(hull, body, stages%y4, stages%g4, h / 6.0_dp * a, e4, b4)
    call rates_vjp(hull, body, stages%y3, stages%g3, h / 3.0_dp * a + h * e4, e3, b3)
    call rates_vjp(hull, body, stages%y2, stages%g2, h / 3.0_dp * a + 0.5_dp * h * e3, e2, b2)
    call rates_vjp(hull, body, stages%y1, stages%g1, h / 6.0_dp * a + 0.5_dp * h * e2, e1, b1)
    by_state = a + e1 + e2 + e3 + e4
    by_disturbance = b1 + b2 + b3 + b4
  end subroutine step_vjp

  ! Horizontal displacement over the step: the Runge-Kutta quadrature of eq. 1 along the stages.
  pure subroutine displacement(stages, h, north, east)
    type(stages_type), intent(in) :: stages
    real(dp), intent(in) :: h
    real(dp), intent(out) :: north, east
    real(dp) :: x1, x2, x3, x4, e1, e2, e3, e4

    call horizontal_velocity(stages%y1, x1, e1)
    call horizontal_velocity(stages%y2, x2, e2)
    call horizontal_velocity(stages%y3, x3, e3)
    call horizontal_velocity(stages%y4, x4, e4)
    north = h / 6.0_dp * (x1 + 2.0_dp * x2 + 2.0_dp * x3 + x4)
    east = h / 6.0_dp * (e1 + 2.0_dp * e2 + 2.0_dp * e3 + e4)
  end subroutine displacement

end module rk4
