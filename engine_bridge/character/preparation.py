"""A mesh made ready to be deformed: welded and reduced, from the cache where that was done before."""

from dataclasses import astuple, fields
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.cache import Arrays, cache_key, load_or_compute
from solver.model.bones import NO_BONES, BoneRegions, Bones
from solver.model.reduced_model import ModelParameters, ReducedModel, build
from solver.surface.mesh import Repairs, SolverMesh, weld

ARRAY_GROUPS = {"bones": Bones, "regions": BoneRegions}
"""Fields of a model that are groups of arrays themselves."""

MODEL_ARRAYS = tuple(
    f"{field.name}.{part.name}" if field.name in ARRAY_GROUPS else field.name
    for field in fields(ReducedModel)
    for part in (fields(ARRAY_GROUPS[field.name]) if field.name in ARRAY_GROUPS else [field])
)


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
    """Weld and reduce a render mesh, or take both from the cache.

    Parameters
    ----------
    positions : (N, 3) float64
    triangles : (T, 3) int64
    parameters : ModelParameters
    folder : Path
        Of the cache, see `engine_bridge.character.cache.load_or_compute`.
    name : str
        What an error message calls the mesh.
    bones : Bones, optional
        Inside the mesh.
    shares : (N, b) float64, optional
        Of each bone in the motion of each render vertex, see `solver.model.reduced_model.build`.

    Raises
    ------
    MeshError
        See `solver.surface.mesh.weld` and `solver.model.reduced_model.build`.
    """

    def make() -> Arrays:
        mesh = weld(positions, triangles, name)
        of_mesh = None if shares is None else _means(shares, mesh.of_render)
        model = build(mesh, parameters, bones, of_mesh)
        welded = {
            "mesh.vertices": mesh.vertices,
            "mesh.faces": mesh.faces,
            "mesh.of_render": mesh.of_render,
            "mesh.repairs": np.array(astuple(mesh.repairs)),
        }
        return welded | {name: attrgetter(name)(model) for name in MODEL_ARRAYS}

    made = load_or_compute(
        folder, cache_key(MODEL_ARRAYS, parameters, positions, triangles, *astuple(bones), shares), make
    )
    repairs = Repairs(*made["mesh.repairs"].tolist())
    mesh = SolverMesh(made["mesh.vertices"], made["mesh.faces"], made["mesh.of_render"], name, repairs)
    groups: dict[str, Any] = {
        field: kind(*(made[f"{field}.{part.name}"] for part in fields(kind))) for field, kind in ARRAY_GROUPS.items()
    }
    alone: dict[str, Any] = {field: made[field] for field in MODEL_ARRAYS if "." not in field}
    return mesh, ReducedModel(**alone, **groups)


def _means(values: NDArray[np.float64], of_render: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the mean values (n, k) of the render vertices (N, k) that are one vertex of the solver's mesh."""
    count = int(of_render.max()) + 1
    sums = np.stack([np.bincount(of_render, column, count) for column in values.T], axis=1)
    return sums / np.bincount(of_render, minlength=count)[:, None]
