"""Fuzzing of the program: unusual inputs, damaged archives, kills, and invariants.

A case is a *recipe*: a small JSON value that says which specimen is edited in which way and which command reads it.
`strategies` draws recipes, `kinds` turns one into files and commands, `program` runs the commands as forks of one loaded
process, `verdicts` judges what is left, `kills` ends long commands at random moments. Recipes that fail are written as
files, which ``python -m benchmarks.fuzz --replay FILE`` runs again; those worth keeping lie in ``tests/corpus``.
"""
