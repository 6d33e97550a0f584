"""Projection of live poses onto the morph targets in a .glb from `puppetline bake`.

Every pose is X = W R, and every direction of the basis moves vertices by W times a point in the space of R. The
coordinates of the nearest pose, in the least-squares sense over all vertices, are therefore one small product for any
mesh. Coordinates become weights within [0, 1] (`engine_bridge.export.unit_weights`). The baked motion has coordinates
from −1 to 1; those of other motion are limited smoothly before they reach the ends of the range of the weights.

A baked file stores its directions in an accessor that no mesh uses, named in the asset's extras. The extras also have
the range, and the length of each target's displacement of the surface. With another mesh or other fields, these lengths
differ, which reveals a basis that does not belong to a character.
"""

from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from engine_bridge.character.document import Document
from engine_bridge.character.document_reader import load_document
from engine_bridge.export.animation import target_names
from engine_bridge.export.morph_basis import surface_coordinates
from engine_bridge.export.unit_weights import UnitWeights
from engine_bridge.performance.prepared_character import PreparedCharacter
from puppetline.compiled import compiled
from puppetline.errors import PuppetError, at
from solver.model.reduced_model import ReducedModel
from solver.motion.retarget import LIMIT_KNEE_SHARE, levelled_off

EXTRAS = "puppetline_morphs"
"""Key in the asset's extras."""

LENGTH_TOLERANCE = 1e-3
"""Maximum relative difference of lengths, because models of a mesh differ by rounding between computers."""

UNLIMITED_REACH = 4.0
"""Maximum coordinate without a limit, as a multiple of the baked motion's largest."""

REACH = UNLIMITED_REACH / LIMIT_KNEE_SHARE
"""Maximum coordinate that the weights of newly baked files represent."""

_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _StoredBasis(BaseModel):
    """Extras about the directions in a file."""

    model_config = ConfigDict(strict=True, extra="ignore")

    directions: Annotated[int, Field(ge=0)]
    lengths: Annotated[list[_Positive], Field(min_length=2)]
    reach: _Positive


class Projection(NamedTuple):
    """Projection of a pose onto a morph basis.

    Attributes
    ----------
    weights : (count,) float32
        Weights of the morph targets, within [0, 1].
    residual : float
        Root mean square distance of vertices from the pose with these weights, as a fraction of the diagonal.
    limited : bool
        Whether the pose is outside the range of the weights along any direction.
    """

    weights: NDArray[np.float32]
    residual: float
    limited: bool


class LiveBasis:
    """Projects poses of a character onto morph targets.

    Parameters
    ----------
    directions : (K, 4m, 3) float32
        Directions, which move vertices by W times them; model units, orthogonal in the metric WᵀW.
    reach : float
        Maximum coordinate along a direction that weights within [0, 1] represent.
    model : ReducedModel
    """

    def __init__(self, directions: NDArray[np.float32], reach: float, model: ReducedModel) -> None:
        unit_weights = UnitWeights.within(np.full(len(directions), reach))
        self.names = tuple(target_names(unit_weights.count))
        """Names of the targets in the file, in the order of the weights."""

        along = _along(directions, model)
        self._reach = reach
        self._rest = model.rest_controls
        self._duals = np.linalg.solve(_metric(directions, along), along)
        self._at_rest = self._duals @ self._rest.ravel()
        targets = unit_weights.targets(directions).astype(np.float32)
        self.targets = np.ascontiguousarray(targets.transpose(0, 2, 1), dtype=np.float64)
        """(count, 3, 4m) float64, model units; target k moves vertices by W times the transpose of entry k."""

        self._surface = (surface_coordinates(model)[0] / np.sqrt(len(model.isoline_coordinates))).astype(np.float32)

    @classmethod
    def load(cls, path: Path, prepared: PreparedCharacter) -> "LiveBasis":
        """Read the basis from a file of `puppetline bake` for a character.

        Raises
        ------
        MeshError
            The file is not glTF, or damaged.
        PuppetError
            The file has no basis, a basis for another mesh or other solver settings, or one of an earlier version.
        """
        directions, carried = _stored_basis(load_document(path), path, prepared.model.rest_controls.shape)
        lengths = np.array(carried.lengths[:-1]) / (2 * carried.reach)
        metric = _metric(directions, _along(directions, prepared.model))
        with np.errstate(all="ignore"):  # NaN is not within the tolerance
            alike = np.abs(metric / np.outer(lengths, lengths) - np.eye(len(lengths))) <= LENGTH_TOLERANCE
        if not alike.all():
            raise _refused(str(path), "morph targets for another mesh", path)
        basis = cls(directions, carried.reach, prepared.model)
        basis.project(prepared.model.rest_controls)  # compiles, which would delay the first frame
        return basis

    def project(self, R: NDArray[np.floating]) -> Projection:
        """Return the weights of the nearest pose, limited to their range.

        Parameters
        ----------
        R : (4m, 3) float
            Control variables, model units.

        Raises
        ------
        ValueError
            The array has another shape.
        """
        if R.shape != self._rest.shape:  # compiled loops would read beyond it
            raise ValueError(f"control variables {R.shape}, expected {self._rest.shape}")
        R = np.ascontiguousarray(R, dtype=np.float64)
        weights = np.empty(len(self.names), dtype=np.float32)
        limited = _project(self._duals, self._at_rest, R.ravel(), self._reach, weights)
        left = np.ascontiguousarray((R - self._rest).T)
        return Projection(weights, float(np.sqrt(_left_over(left, self.targets, weights, self._surface))), limited)


def _along(directions: NDArray[np.floating], model: ReducedModel) -> NDArray[np.float64]:
    """Return the matrix (K, 12m) from a difference of control variables to its scalar products with the directions.

    The products are means over the vertices, in square mesh units.
    """
    mean = float(model.diagonal) ** 2 / len(model.isoline_coordinates)
    return mean * np.einsum("ij,kjx->kix", model.gram, directions.astype(np.float64), optimize=True).reshape(
        len(directions), -1
    )


def _metric(directions: NDArray[np.floating], along: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the scalar products (K, K) of the directions, with their squared lengths on the diagonal."""
    return directions.astype(np.float64).reshape(along.shape) @ along.T


def store_basis(document: Document, directions: NDArray[np.floating], reach: float, model: ReducedModel) -> None:
    """Store the directions of a document's morph targets for `LiveBasis.load`.

    Parameters
    ----------
    document : Document
        Document whose meshes end with these targets.
    directions : (K, 4m, 3)
        At least one direction, orthogonal in the metric WᵀW; stored as float32.
    reach : float
        Maximum coordinate along a direction for the targets.
    model : ReducedModel
    """
    kept = directions.astype(np.float32)
    targets = UnitWeights.within(np.full(len(kept), reach)).targets(kept)
    lengths = np.sqrt(np.diag(_metric(targets, _along(targets, model))))
    carried = {"directions": document.add(kept.reshape(-1, 3)), "lengths": lengths.tolist(), "reach": reach}
    asset: dict[str, Any] = document.gltf["asset"]  # type: ignore[assignment]  # open: it may hold more than is named
    extras = asset["extras"] if isinstance(asset.get("extras"), dict) else {}
    asset["extras"] = {**extras, EXTRAS: carried}


def _stored_basis(document: Document, path: Path, shape: tuple[int, ...]) -> tuple[NDArray[np.float32], _StoredBasis]:
    """Return the directions (K, 4m, 3) in a document, and its extras about them."""
    extras = document.gltf["asset"].get("extras")
    where = at(path, field=f"asset.extras.{EXTRAS}")
    if not isinstance(extras, dict) or EXTRAS not in extras:
        raise _refused(where, "no morph basis", path)
    if isinstance(extras[EXTRAS], dict) and "reach" not in extras[EXTRAS]:
        raise _refused(where, "a basis of an earlier version, whose weights are not limited to 0 … 1", path)
    try:
        carried = _StoredBasis.model_validate(extras[EXTRAS])
    except ValidationError as error:
        raise _refused(where, f"a damaged basis ({error.errors()[0]['msg']})", path) from error
    if carried.directions >= len(document.gltf["accessors"]):
        raise _refused(where, f"accessor {carried.directions} of {len(document.gltf['accessors'])}", path)
    directions = document.array(carried.directions)
    if directions.dtype != np.float32 or directions.ndim != 2 or not np.isfinite(directions).all():
        raise _refused(where, "directions that are not finite float32 numbers", path)
    count = len(carried.lengths) - 1
    if directions.shape != (count * shape[0], 3):
        raise _refused(str(path), "morph targets for other solver settings", path)
    return directions.reshape(count, *shape), carried


def _refused(where: str, found: str, path: Path) -> PuppetError:
    return PuppetError(
        where,
        found=found,
        expected="the morph basis of this puppet's character",
        fix=f"Create it: puppetline bake PUPPET.toml -o {path}",
    )


@compiled
def _project(duals, at_rest, R, reach, weights):
    """Write the weights (K + 1,) of flat control variables; return whether a coordinate is beyond its range.

    This is `UnitWeights.within` for one frame: coordinates c within ± reach become (c / reach + m) / 2 and m.
    """
    limited = False
    opposite = 0.0
    count = len(duals)
    for k in range(count):
        total = _product(duals[k], R) - at_rest[k]
        share = levelled_off(abs(total) / reach)
        limited = limited or abs(total) > reach
        weights[k] = share if total > 0 else -share
        opposite = max(opposite, -weights[k])
    for k in range(count):
        weights[k] = (weights[k] + opposite) / 2
    weights[count] = opposite
    return limited


@compiled(inner=True, fastmath=True)
def _product(a, b):
    """Return the scalar product of two vectors; the compiler may reorder additions here, but not in the caller."""
    total = 0.0
    for j in range(len(a)):
        total += a[j] * b[j]
    return total


@compiled(fastmath=True)
def _left_over(left, targets, weights, surface):
    """Return the squared length of a difference (3, 4m) of control variables minus the weighted targets."""
    for k in range(len(targets)):
        for axis in range(3):
            for j in range(left.shape[1]):
                left[axis, j] -= weights[k] * targets[k, axis, j]
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
