"""Compiled formulas on plain float64: SI units, radians, NED, no checks, no exceptions, no allocation in a time loop.

The callers, ``gliderhpc.flight`` and ``gliderhpc.estimation``, validate and allocate; a kernel computes. Read the
modules in this order: ``elementary``, ``parameters``, ``mass``, ``hydrodynamics``, ``dynamics``, ``jacobian``, ``rk4``,
``window``, ``current``, ``tangent``, ``kalman``. A function and its transposed derivative have matching names:
``rates``/``rates_vjp``, ``step``/``step_vjp``.
"""

if __name__ != "gliderhpc.kernels":
    raise ImportError("'kernels' at the top of the repository is a link into the package; import gliderhpc.kernels")
