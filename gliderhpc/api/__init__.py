"""The Python interface: the functions that ``import gliderhpc`` gives, which the commands call too.

`arguments` brings the arguments into one form, which is then passed to the library. Records are given as Datasets or
paths; results are xarray objects, tables or figures.
"""
