"""The Python interface: the functions that ``import gliderhpc`` gives, which the commands call too.

Arguments are looked after here (`arguments`), then handed to the library; records go in as Datasets or paths, results
come out as xarray objects, tables or figures.
"""
