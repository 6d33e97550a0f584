"""A state of arrays that is carried from frame to frame, which can be saved and continued."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


class Carried:
    """Something with a state: a named tuple of arrays that its steps change in place."""

    _state: Any

    @property
    def memory(self) -> dict[str, NDArray[np.float64]]:
        """The state carried from frame to frame; setting it continues where another one of the same parts was."""
        return {name: values.copy() for name, values in self._state._asdict().items()}

    @memory.setter
    def memory(self, memory: dict[str, NDArray[np.float64]]) -> None:
        for name, values in self._state._asdict().items():
            values[:] = memory[name]
