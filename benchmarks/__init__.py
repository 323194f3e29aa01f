"""Programs that make the figures in the README and in ``docs/``: cost and accuracy of the project.

``python -m benchmarks.run`` (``make bench``) times the engines and their peers and what bounds them, ``python -m
benchmarks.mission`` a whole mission; both write ``benchmarks/results.json``, from which ``readme`` renders the README's
section on performance. ``accuracy``, ``calibration``, ``scenario_current``, ``twins`` and ``real_missions`` write pages of
``docs/``; ``twins`` also the README's claim about accuracy, from ``gliderhpc twin estimators``.
"""
