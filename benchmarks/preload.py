"""Preload all modules of the commands, for processes that are forked for every command."""

LIBRARIES = (
    "matplotlib.backends.backend_agg", "matplotlib.backends.backend_svg", "matplotlib.figure", "pymannkendall",
    "scipy.fft", "scipy.interpolate", "scipy.linalg", "scipy.ndimage", "scipy.optimize.elementwise", "scipy.signal",
    "scipy.sparse", "scipy.stats",
)  # fmt: skip


def preload(kernels: bool) -> None:
    """Import every command, every study and their libraries, and load the kernels where asked."""
    from gliderhpc.cli.main import VERBS
    from gliderhpc.studies.registry import ALL_STUDIES

    studies = [f"gliderhpc.{part}" for study in ALL_STUDIES for part in (f"studies.{study}", f"report.studies.{study}")]
    for name in (*LIBRARIES, *(f"gliderhpc.cli.{module}" for module in VERBS.values()), *studies):
        __import__(name)
    if kernels:
        from gliderhpc.mission.warm import warm_kernels, warm_simulator

        warm_kernels()
        warm_simulator()
