"""Positions and normals by avx2_blend.c, which Puppetline's code is compared with."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np

from solver.model.binding import ShadedBinding
from solver.model.reduced_model import Controls, ReducedModel

SOURCE = Path(__file__).with_name("avx2_blend.c")
FIELDS = 8
"""Number of fields that avx2_blend.c supports."""


class MissingError(Exception):
    """The loop in C cannot run on this machine; the message states why."""


class Avx2Blend:
    """Positions and normals of one frame, from a loop in C.

    Parameters
    ----------
    folder : Path
        Folder for the compiled library.
    model : ReducedModel
    binding : ShadedBinding
        Binding of the vertices.

    Raises
    ------
    MissingError
    """

    def __init__(self, folder: Path, model: ReducedModel, binding: ShadedBinding) -> None:
        if len(model.weights) != FIELDS:
            raise MissingError(f"avx2_blend.c supports {FIELDS} fields only")
        self._frame = _compiled(folder).frame
        weights = model.weights.astype(np.float32)
        self._isolines = model.isolines
        self._of_vertices = [weights, binding.rest, binding._tangents, binding._slopes, binding._isoline_coordinates]
        self.positions, self.normals = np.empty_like(binding.rest), np.empty_like(binding.rest)

    def __call__(self, controls: Controls) -> None:
        """Write `positions` and `normals` (n, 3)."""
        self._frame(
            ctypes.c_size_t(len(self.positions)),
            ctypes.c_int(self._isolines),
            *(
                ctypes.c_void_p(array.ctypes.data)
                for array in (controls, *self._of_vertices, self.positions, self.normals)
            ),
        )


def _compiled(folder: Path) -> ctypes.CDLL:
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise MissingError("there is no C compiler")
    cpu = Path("/proc/cpuinfo")
    if cpu.exists() and "avx2" not in cpu.read_text(encoding="utf-8"):
        raise MissingError("the processor has no AVX2")
    library = folder / "avx2_blend.so"
    command = [compiler, "-O3", "-mavx2", "-mfma", "-shared", "-fPIC", "-o", library, SOURCE]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise MissingError(f"{compiler} cannot compile avx2_blend.c: {done.stderr.splitlines()[0]}")
    return ctypes.CDLL(str(library))
