"""Live poses as weights of the morph targets in a .glb that `puppetline bake` made.

Every pose is X = W R and every target is W times a direction in the space of R. So the weights that come nearest to a
pose, in the least-squares sense over all vertices, are one small product, whatever the mesh. A baked file carries its
directions in an accessor that no mesh uses, named in the asset's extras. Beside it stands how far each target moves the
surface: on another mesh, or with other fields, the directions move it otherwise, which gives away a basis that does not
belong to a character.
"""

from pathlib import Path
from typing import Annotated, Any

import numba
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from engine_bridge.gltf.animation import target_names
from engine_bridge.gltf.document import Document
from engine_bridge.gltf.morph_basis import surface_coordinates
from engine_bridge.rig import Rig
from puppetline.errors import PuppetError, at
from solver.reduced_model import ReducedModel

EXTRAS = "puppetline_morphs"
"""The name in the asset's extras."""

SAME = 1e-3
"""Share by which lengths may differ: computed elsewhere, a model of the same mesh differs by rounding."""


class _Carried(BaseModel):
    """What a file says about its directions."""

    model_config = ConfigDict(strict=True, extra="ignore")

    directions: Annotated[int, Field(ge=0)]
    lengths: Annotated[list[Annotated[float, Field(gt=0, allow_inf_nan=False)]], Field(min_length=1)]


class LiveBasis:
    """Turns poses of a character into weights of morph targets.

    Parameters
    ----------
    directions : (K, 4m, 3) float32
        Model units; target k is W times direction k.
    model : ReducedModel
    """

    def __init__(self, directions: NDArray[np.float32], model: ReducedModel) -> None:
        self.names = tuple(target_names(len(directions)))
        """What the targets are called in the file, in the order of the weights."""

        along = _along(directions, model)
        self._rest = model.rest_controls
        self._duals = np.linalg.solve(_metric(directions, along), along)
        self._at_rest = self._duals @ self._rest.ravel()
        self.directions = np.ascontiguousarray(directions.transpose(0, 2, 1), dtype=np.float64)
        """(K, 3, 4m) float64, model units."""

        self._surface = (surface_coordinates(model)[0] / np.sqrt(len(model.ladder))).astype(np.float32)

    @classmethod
    def load(cls, path: Path, rig: Rig) -> "LiveBasis":
        """Take the basis out of a file that `puppetline bake` made for a character.

        Raises
        ------
        MeshError
            No glTF, or damaged.
        PuppetError
            No basis in it, or one for another mesh or other solver settings.
        """
        directions, lengths = _carried(Document.load(path), path, rig.model.rest_controls.shape)
        metric = _metric(directions, _along(directions, rig.model))
        with np.errstate(all="ignore"):  # what is no number is not alike
            alike = np.abs(metric / np.outer(lengths, lengths) - np.eye(len(lengths))) <= SAME
        if not alike.all():
            raise _refused(str(path), "morph targets that were made for another mesh", path)
        basis = cls(directions, rig.model)
        at_rest = rig.model.rest_controls
        basis.residual(at_rest, basis.weights(at_rest))  # compiled now, or the first frame would wait for it
        return basis

    def weights(self, R: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return the weights (K,) float32 that come nearest to a pose.

        Parameters
        ----------
        R : (4m, 3) float
            Control variables, model units.

        Raises
        ------
        ValueError
            An array of another shape.
        """
        weights = np.empty(len(self.names), dtype=np.float32)
        _project(self._duals, self._at_rest, self._checked(R).ravel(), weights)
        return weights

    def residual(self, R: NDArray[np.floating], weights: NDArray[np.float32]) -> float:
        """Return how far vertices are from a pose with these weights: root mean square, as a fraction of the diagonal.

        Parameters
        ----------
        R : (4m, 3) float
            Control variables, model units.
        weights : (K,) float32

        Raises
        ------
        ValueError
            Arrays of other shapes.
        """
        if weights.shape != (len(self.names),):
            raise ValueError(f"{weights.shape} weights of {len(self.names)} targets")
        left = np.ascontiguousarray((self._checked(R) - self._rest).T)
        return float(np.sqrt(_left_over(left, self.directions, weights, self._surface)))

    def _checked(self, R: NDArray[np.floating]) -> NDArray[np.float64]:
        """Refuse what compiled loops would read beyond."""
        if R.shape != self._rest.shape:
            raise ValueError(f"control variables {R.shape}, expected {self._rest.shape}")
        return np.ascontiguousarray(R, dtype=np.float64)


def _along(directions: NDArray[np.floating], model: ReducedModel) -> NDArray[np.float64]:
    """Return (K, 12m): what a difference of control variables is multiplied by to be set against each direction.

    The products are means over the vertices, in square mesh units.
    """
    mean = float(model.diagonal) ** 2 / len(model.ladder)
    return mean * np.einsum("ij,kjx->kix", model.gram, directions.astype(np.float64), optimize=True).reshape(
        len(directions), -1
    )


def _metric(directions: NDArray[np.floating], along: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (K, K) the directions set against each other: squares of lengths, and zeros where they are orthogonal."""
    return directions.astype(np.float64).reshape(along.shape) @ along.T


def carry(document: Document, directions: NDArray[np.floating], model: ReducedModel) -> None:
    """Put the directions of a document's morph targets into it, for `LiveBasis.load`.

    Parameters
    ----------
    document : Document
        With the targets in it, the last of each mesh.
    directions : (K, 4m, 3)
        Orthogonal in the metric WᵀW; at least one. Kept as float32.
    model : ReducedModel
    """
    kept = directions.astype(np.float32)
    lengths = np.sqrt(np.diag(_metric(kept, _along(kept, model))))
    carried = {"directions": document.add(kept.reshape(-1, 3)), "lengths": lengths.tolist()}
    asset: dict[str, Any] = document.gltf["asset"]  # type: ignore[assignment]  # open: it may hold more than is named
    extras = asset["extras"] if isinstance(asset.get("extras"), dict) else {}
    asset["extras"] = {**extras, EXTRAS: carried}


def _carried(document: Document, path: Path, shape: tuple[int, ...]) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return the (K, 4m, 3) directions that a document carries, and their (K,) lengths."""
    extras = document.gltf["asset"].get("extras")
    where = at(path, field=f"asset.extras.{EXTRAS}")
    if not isinstance(extras, dict) or EXTRAS not in extras:
        raise _refused(where, "none", path)
    try:
        carried = _Carried.model_validate(extras[EXTRAS])
    except ValidationError as error:
        raise _refused(where, f"a damaged one ({error.errors()[0]['msg']})", path) from error
    if carried.directions >= len(document.gltf["accessors"]):
        raise _refused(where, f"accessor {carried.directions} of {len(document.gltf['accessors'])}", path)
    directions = document.array(carried.directions)
    if directions.dtype != np.float32 or directions.ndim != 2 or not np.isfinite(directions).all():
        raise _refused(where, "directions that are no numbers", path)
    count = len(carried.lengths)
    if directions.shape != (count * shape[0], 3):
        raise _refused(str(path), "morph targets that were made with other solver settings", path)
    return directions.reshape(count, *shape), np.array(carried.lengths)


def _refused(where: str, found: str, path: Path) -> PuppetError:
    return PuppetError(
        where,
        found=found,
        expected="the morph basis of this puppet's character",
        fix=f"Make it: puppetline bake PUPPET.toml -o {path}",
    )


@numba.njit(cache=True, fastmath=True, nogil=True)
def _project(duals, at_rest, R, weights):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Write the (K,) products of flat control variables with the duals, less those of the rest pose."""
    for k in range(len(duals)):
        total = 0.0
        for j in range(len(R)):
            total += duals[k, j] * R[j]
        weights[k] = total - at_rest[k]


@numba.njit(cache=True, fastmath=True, nogil=True)
def _left_over(left, directions, weights, surface):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return the square of what the targets leave of a (3, 4m) difference of control variables."""
    for k in range(len(directions)):
        for axis in range(3):
            for j in range(left.shape[1]):
                left[axis, j] -= weights[k] * directions[k, axis, j]
    x, y, z = left.astype(np.float32)
    square = 0.0
    for i in range(len(surface)):
        a = b = c = np.float32(0)
        for j in range(surface.shape[1]):
            a += surface[i, j] * x[j]
            b += surface[i, j] * y[j]
            c += surface[i, j] * z[j]
        square += float(a * a + b * b + c * c)
    return square
