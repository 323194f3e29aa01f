"""Python interface: the functions that ``import gliderhpc`` provides. The commands call them too.

The module `arguments` converts the arguments into one form, which is then passed to the library. Records are Datasets
or paths; results are xarray objects, tables or figures.
"""
