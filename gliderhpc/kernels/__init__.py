"""Compiled formulas on plain float64: SI units, radians, NED, no checks, no exceptions, no allocation in a time loop.

A caller validates and allocates (``gliderhpc.flight`` and ``gliderhpc.estimation`` do); a kernel computes. Read in this
order: ``elementary``, ``parameters``, ``mass``, ``hydrodynamics``, ``dynamics``, ``jacobian``, ``rk4``, ``window``,
``current``, ``tangent``, ``kalman``. Pairs are named alike: ``rates``/``rates_vjp``, ``step``/``step_vjp``.
"""

if __name__ != "gliderhpc.kernels":
    raise ImportError("'kernels' at the top of the repository is a link into the package; import gliderhpc.kernels")
