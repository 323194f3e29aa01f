"""Fortran versions of the kernels: the same formulas in the same order under the same names, compiled ahead of time.

There is one Fortran file for each module of `gliderhpc.kernels` that the windows and the filter's tangent step need.
`build` compiles them into one shared library next to them, `library` loads it, and
`gliderhpc.estimation.fortran_check` compares it with Numba's.
"""
