"""The Fortran engine: the lanes engine, its cost and gradient by the library that ``make fortran`` builds.

Windows, lanes and quasi-Newton method are one code; what differs is who evaluates the trials.
"""

from collections.abc import Callable

from gliderhpc.errors import InputError
from gliderhpc.kernels.fortran.library import Library, LibraryError, load
from gliderhpc.kernels.lane_memory import Descent, Problem, Progress
from gliderhpc.kernels.quasi_newton import proceed


def fortran_library() -> Library:
    """Load the library.

    Raises
    ------
    InputError
        It cannot be used here; the message says how to build it.
    """
    try:
        return load()
    except LibraryError as error:
        raise InputError(f"engine fortran: {error}") from None


class FortranRun:
    """`gliderhpc.kernels.quasi_newton.run_until_done` for a batch that the library evaluates.

    Raises
    ------
    InputError
        The library cannot be used here.
    """

    def __init__(self) -> None:
        self._library = fortran_library()
        self._problem: Problem | None = None
        self._evaluate: Callable[[], None] | None = None

    def __call__(self, problem: Problem, descent: Descent, progress: Progress, max_iterations: int) -> None:
        """Evaluate and decide until a lane is done or none is left at work."""
        evaluate = self._evaluation(problem)
        done = False
        while not done:
            evaluate()
            done = proceed(problem, descent, progress, max_iterations)

    def _evaluation(self, problem: Problem) -> Callable[[], None]:
        """The library's call for this memory, which changes only where it has to grow."""
        if self._evaluate is None or problem is not self._problem:
            self._problem, self._evaluate = problem, self._library.evaluation(problem)
        return self._evaluate
