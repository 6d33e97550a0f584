"""Preparation of a mesh for deformation: welding and model reduction, with a cache."""

from dataclasses import astuple, fields
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from engine_bridge.character.cache import Arrays, cache_key, load_or_compute
from solver.model.bones import NO_BONES, BoneRegions, Bones
from solver.model.reduced_model import ModelParameters, ReducedModel, build
from solver.surface.mesh import Repairs, SolverMesh, weld

ARRAY_GROUPS = {"bones": Bones, "regions": BoneRegions}
"""Fields of a model that consist of several arrays, and their types."""

MODEL_ARRAYS = tuple(
    f"{field.name}.{part.name}" if field.name in ARRAY_GROUPS else field.name
    for field in fields(ReducedModel)
    for part in (fields(ARRAY_GROUPS[field.name]) if field.name in ARRAY_GROUPS else [field])
)
"""Names of a model's arrays in the cache."""


def prepare(
    positions: NDArray[np.float64],
    triangles: NDArray[np.int64],
    parameters: ModelParameters,
    folder: Path,
    name: str = "mesh",
    *,
    bones: Bones = NO_BONES,
    shares: NDArray[np.float64] | None = None,
) -> tuple[SolverMesh, ReducedModel]:
    """Weld and reduce a render mesh, or read both results from the cache.

    Parameters
    ----------
    positions : (N, 3) float64
    triangles : (T, 3) int64
    parameters : ModelParameters
    folder : Path
        Folder of the cache, see `engine_bridge.character.cache.load_or_compute`.
    name : str
        Name of the mesh in error messages.
    bones : Bones, optional
        Bones inside the mesh.
    shares : (N, b) float64, optional
        Share of each bone in the motion of each render vertex, see `solver.model.reduced_model.build`.

    Raises
    ------
    MeshError
        See `solver.surface.mesh.weld` and `solver.model.reduced_model.build`.
    """

    def make() -> Arrays:
        mesh = weld(positions, triangles, name)
        of_mesh = None if shares is None else _of_solver_vertices(shares, mesh)
        model = build(mesh, parameters, bones, of_mesh)
        welded = {f"mesh.{name}": getattr(mesh, name) for name in ("vertices", "faces", "of_render")}
        welded["mesh.repairs"] = np.array(astuple(mesh.repairs))
        return welded | {name: attrgetter(name)(model) for name in MODEL_ARRAYS}

    arrays = load_or_compute(
        folder, cache_key(MODEL_ARRAYS, parameters, positions, triangles, *astuple(bones), shares), make
    )
    repairs = Repairs(*arrays["mesh.repairs"].tolist())
    mesh = SolverMesh(arrays["mesh.vertices"], arrays["mesh.faces"], arrays["mesh.of_render"], name, repairs)
    groups: dict[str, Any] = {
        field: kind(*(arrays[f"{field}.{part.name}"] for part in fields(kind))) for field, kind in ARRAY_GROUPS.items()
    }
    alone: dict[str, Any] = {field: arrays[field] for field in MODEL_ARRAYS if "." not in field}
    return mesh, ReducedModel(**alone, **groups)


def _of_solver_vertices(values: NDArray[np.float64], mesh: SolverMesh) -> NDArray[np.float64]:
    """Return the means (n, k) of values (N, k) over the render vertices of each solver vertex.

    Vertices by which a coarse mesh was refined have the values of the nearest one of their part.
    """
    count = int(mesh.of_render.max()) + 1
    sums = np.stack([np.bincount(mesh.of_render, column, count) for column in values.T], axis=1)
    means = np.zeros((len(mesh.vertices), values.shape[1]))
    means[:count] = sums / np.bincount(mesh.of_render, minlength=count)[:, None]
    added = np.arange(len(means)) >= count
    for part in np.unique(mesh.components[added]):
        own, new = (np.flatnonzero((mesh.components == part) & chosen) for chosen in (~added, added))
        means[new] = means[own[scipy.spatial.cKDTree(mesh.vertices[own]).query(mesh.vertices[new])[1]]]
    return means
