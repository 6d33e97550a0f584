"""Live poses as weights of the morph targets in a .glb that `puppetline bake` made.

Every pose is X = W R and every direction of the basis moves vertices by W times a point in the space of R. So the
coordinates that come nearest to a pose, in the least-squares sense over all vertices, are one small product, whatever
the mesh. Coordinates become weights within [0, 1] (`engine_bridge.export.unit_weights`). The baked motion has
coordinates from −1 to 1; those of other motion are limited softly before they reach the ends of the range
that the weights cover.

A baked file carries its directions in an accessor that no mesh uses, named in the asset's extras. Beside it are the
range and how far each target moves the surface: on another mesh, or with other fields, the directions move it
otherwise, which reveals a basis that does not belong to a character.
"""

from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from engine_bridge.character.document import Document
from engine_bridge.export.animation import target_names
from engine_bridge.export.morph_basis import surface_coordinates
from engine_bridge.export.unit_weights import UnitWeights
from engine_bridge.performance.rig import Rig
from puppetline.errors import PuppetError, at
from solver.model.reduced_model import ReducedModel
from solver.motion.retarget import LIMIT_KNEE, levelled_off

EXTRAS = "puppetline_morphs"
"""The name in the asset's extras."""

LENGTH_TOLERANCE = 1e-3
"""Share by which lengths may differ: computed elsewhere, a model of the same mesh differs by rounding."""

UNLIMITED = 4.0
"""Coordinates up to this, as multiples of the baked motion's largest, are not limited: other motion goes farther."""

REACH = UNLIMITED / LIMIT_KNEE
"""The largest coordinate that weights of newly baked files cover."""

_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _StoredBasis(BaseModel):
    """What a file says about its directions."""

    model_config = ConfigDict(strict=True, extra="ignore")

    directions: Annotated[int, Field(ge=0)]
    lengths: Annotated[list[_Positive], Field(min_length=2)]
    reach: _Positive


class Projection(NamedTuple):
    """A pose on a morph basis.

    Attributes
    ----------
    weights : (count,) float32
        Of the morph targets, within [0, 1].
    residual : float
        How far vertices are from the pose with these weights: root mean square, as a fraction of the diagonal.
    limited : bool
        Whether the pose is beyond the range that weights cover, along any direction.
    """

    weights: NDArray[np.float32]
    residual: float
    limited: bool


class LiveBasis:
    """Turns poses of a character into weights of morph targets.

    Parameters
    ----------
    directions : (K, 4m, 3) float32
        Model units; direction k moves vertices by W times it. Orthogonal in the metric WᵀW.
    reach : float
        The largest coordinate along a direction that has weights within [0, 1].
    model : ReducedModel
    """

    def __init__(self, directions: NDArray[np.float32], reach: float, model: ReducedModel) -> None:
        unit_weights = UnitWeights.within(np.full(len(directions), reach))
        self.names = tuple(target_names(unit_weights.count))
        """What the targets are called in the file, in the order of the weights."""

        along = _along(directions, model)
        self._reach = reach
        self._rest = model.rest_controls
        self._duals = np.linalg.solve(_metric(directions, along), along)
        self._at_rest = self._duals @ self._rest.ravel()
        targets = unit_weights.targets(directions).astype(np.float32)
        self.targets = np.ascontiguousarray(targets.transpose(0, 2, 1), dtype=np.float64)
        """(count, 3, 4m) float64, model units; target k moves vertices by W times the transpose of entry k."""

        self._surface = (surface_coordinates(model)[0] / np.sqrt(len(model.ladder))).astype(np.float32)

    @classmethod
    def load(cls, path: Path, rig: Rig) -> "LiveBasis":
        """Take the basis out of a file that `puppetline bake` made for a character.

        Raises
        ------
        MeshError
            No glTF, or damaged.
        PuppetError
            No basis in it, or one for another mesh or other solver settings, or of an earlier version.
        """
        directions, carried = _stored_basis(Document.load(path), path, rig.model.rest_controls.shape)
        lengths = np.array(carried.lengths[:-1]) / (2 * carried.reach)
        metric = _metric(directions, _along(directions, rig.model))
        with np.errstate(all="ignore"):  # what is no number is not alike
            alike = np.abs(metric / np.outer(lengths, lengths) - np.eye(len(lengths))) <= LENGTH_TOLERANCE
        if not alike.all():
            raise _refused(str(path), "morph targets that were made for another mesh", path)
        basis = cls(directions, carried.reach, rig.model)
        basis.project(rig.model.rest_controls)  # compiled now, or the first frame would wait for it
        return basis

    def project(self, R: NDArray[np.floating]) -> Projection:
        """Return the weights that come nearest to a pose, limited to their range.

        Parameters
        ----------
        R : (4m, 3) float
            Control variables, model units.

        Raises
        ------
        ValueError
            An array of another shape.
        """
        if R.shape != self._rest.shape:  # compiled loops would read beyond it
            raise ValueError(f"control variables {R.shape}, expected {self._rest.shape}")
        R = np.ascontiguousarray(R, dtype=np.float64)
        weights = np.empty(len(self.names), dtype=np.float32)
        limited = _project(self._duals, self._at_rest, R.ravel(), self._reach, weights)
        left = np.ascontiguousarray((R - self._rest).T)
        return Projection(weights, float(np.sqrt(_left_over(left, self.targets, weights, self._surface))), limited)


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


def add_basis(document: Document, directions: NDArray[np.floating], reach: float, model: ReducedModel) -> None:
    """Put the directions of a document's morph targets into it, for `LiveBasis.load`.

    Parameters
    ----------
    document : Document
        With the targets in it, the last of each mesh.
    directions : (K, 4m, 3)
        Orthogonal in the metric WᵀW; at least one. Kept as float32.
    reach : float
        The largest coordinate along a direction for which the targets are made.
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
    """Return the (K, 4m, 3) directions that a document carries, and what it says about them."""
    extras = document.gltf["asset"].get("extras")
    where = at(path, field=f"asset.extras.{EXTRAS}")
    if not isinstance(extras, dict) or EXTRAS not in extras:
        raise _refused(where, "none", path)
    if isinstance(extras[EXTRAS], dict) and "reach" not in extras[EXTRAS]:
        raise _refused(where, "one of an earlier version, whose weights are not limited to 0 … 1", path)
    try:
        carried = _StoredBasis.model_validate(extras[EXTRAS])
    except ValidationError as error:
        raise _refused(where, f"a damaged one ({error.errors()[0]['msg']})", path) from error
    if carried.directions >= len(document.gltf["accessors"]):
        raise _refused(where, f"accessor {carried.directions} of {len(document.gltf['accessors'])}", path)
    directions = document.array(carried.directions)
    if directions.dtype != np.float32 or directions.ndim != 2 or not np.isfinite(directions).all():
        raise _refused(where, "directions that are no numbers", path)
    count = len(carried.lengths) - 1
    if directions.shape != (count * shape[0], 3):
        raise _refused(str(path), "morph targets that were made with other solver settings", path)
    return directions.reshape(count, *shape), carried


def _refused(where: str, found: str, path: Path) -> PuppetError:
    return PuppetError(
        where,
        found=found,
        expected="the morph basis of this puppet's character",
        fix=f"Make it: puppetline bake PUPPET.toml -o {path}",
    )


@numba.njit(cache=True, nogil=True)
def _project(duals, at_rest, R, reach, weights):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Write the weights (K + 1,) of flat control variables; return whether a coordinate is beyond its range.

    This is `UnitWeights.within` for one frame: coordinates c within ± reach become (c / reach + m) / 2, and m.
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


@numba.njit(cache=True, fastmath=True, nogil=True)
def _product(a, b):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return the scalar product of two vectors; only here may the order of additions change."""
    total = 0.0
    for j in range(len(a)):
        total += a[j] * b[j]
    return total


@numba.njit(cache=True, fastmath=True, nogil=True)
def _left_over(left, targets, weights, surface):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return the square of what the targets leave of a (3, 4m) difference of control variables."""
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
