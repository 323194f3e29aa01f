"""Count of floating-point operations in one step of the gradient: the kernels run once on counting numbers.

``NUMBA_DISABLE_JIT=1 python -m benchmarks.operations`` prints the count; `operations_a_step` runs that.
"""

import json
import os
import subprocess
import sys
from typing import Any, ClassVar

import numpy as np


class Counted:
    """A number that counts what is done with it; sign changes and comparisons are free."""

    total: ClassVar[int] = 0

    def __init__(self, value: float) -> None:
        self.value = float(value)

    def _with(self, value: float) -> "Counted":
        Counted.total += 1
        return Counted(value)

    def __add__(self, other: Any) -> "Counted":
        return self._with(self.value + _value(other))

    def __sub__(self, other: Any) -> "Counted":
        return self._with(self.value - _value(other))

    def __rsub__(self, other: Any) -> "Counted":
        return self._with(_value(other) - self.value)

    def __mul__(self, other: Any) -> "Counted":
        return self._with(self.value * _value(other))

    def __truediv__(self, other: Any) -> "Counted":
        return self._with(self.value / _value(other))

    def __rtruediv__(self, other: Any) -> "Counted":
        return self._with(_value(other) / self.value)

    def __pow__(self, other: Any) -> "Counted":
        return self._with(self.value ** _value(other))

    __radd__ = __add__
    __rmul__ = __mul__

    def __neg__(self) -> "Counted":
        return Counted(-self.value)

    def __abs__(self) -> "Counted":
        return Counted(abs(self.value))

    def sqrt(self) -> "Counted":
        """Square root: what numpy calls on an object."""
        return self._with(self.value**0.5)

    def __float__(self) -> float:
        return self.value

    def __lt__(self, other: Any) -> bool:
        return self.value < _value(other)

    def __gt__(self, other: Any) -> bool:
        return self.value > _value(other)

    def __eq__(self, other: object) -> bool:
        return self.value == _value(other)

    __hash__ = None  # type: ignore[assignment]


def count_of(function: Any, *arguments: Any) -> int:
    """Operations that a function of counted numbers does."""
    before = Counted.total
    function(*arguments)
    return Counted.total - before


def operations_a_step() -> int:
    """Floating-point operations of one step of cost and gradient, forward and back, in the project's own formulas."""
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.operations"], capture_output=True, text=True, check=True, env=environment
    )
    return int(json.loads(done.stdout))


def _value(number: Any) -> float:
    return float(number)


def _counted(*shape: int) -> Any:
    """Array of counted numbers, all different."""
    values = 0.1 + 0.01 * np.arange(np.prod(shape))
    return np.array([Counted(value) for value in values], dtype=object).reshape(shape)


def _count_a_step() -> int:
    from gliderhpc import Glider, load_platform
    from gliderhpc.kernels import window

    hull = Glider(load_platform("petrel-l")).hull

    def gradient(steps: int) -> int:
        n = steps
        return count_of(
            window.cost_and_gradient, hull, _counted(n, 11), _counted(1, 10), _counted(n, 6), _counted(n + 1, 4),
            _counted(n + 1), 0.1, _counted(n + 1, 10), _counted(n, window.TAPE), _counted(n, 6), _counted(10),
            _counted(1),
        )  # fmt: skip

    # What does not belong to a step cancels.
    return gradient(2) - gradient(1)


if __name__ == "__main__":
    print(json.dumps(_count_a_step()))
