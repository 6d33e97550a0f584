"""A mesh made ready to be deformed: welded and reduced, from the cache where that was done before."""

from dataclasses import astuple, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.cache import Arrays, key_of, recall
from solver.model.reduced_model import ModelParameters, ReducedModel, build
from solver.surface.mesh import Repairs, SolverMesh, weld

MODEL = tuple(field.name for field in fields(ReducedModel))


def prepare(
    positions: NDArray[np.float64],
    triangles: NDArray[np.int64],
    parameters: ModelParameters,
    folder: Path,
    name: str = "mesh",
) -> tuple[SolverMesh, ReducedModel]:
    """Weld and reduce a render mesh, or take both from the cache.

    Parameters
    ----------
    positions : (N, 3) float64
    triangles : (T, 3) int64
    parameters : ModelParameters
    folder : Path
        Of the cache, see `engine_bridge.character.cache.recall`.
    name : str
        What an error message calls the mesh.

    Raises
    ------
    MeshError
        See `solver.surface.mesh.weld` and `solver.model.reduced_model.build`.
    """

    def make() -> Arrays:
        mesh = weld(positions, triangles, name)
        model = build(mesh, parameters)
        of_mesh = {
            "mesh.vertices": mesh.vertices,
            "mesh.faces": mesh.faces,
            "mesh.of_render": mesh.of_render,
            "mesh.repairs": np.array(astuple(mesh.repairs)),
        }
        return of_mesh | {field: getattr(model, field) for field in MODEL}

    made = recall(folder, key_of(MODEL, parameters, positions, triangles), make)
    repairs = Repairs(*made["mesh.repairs"].tolist())
    mesh = SolverMesh(made["mesh.vertices"], made["mesh.faces"], made["mesh.of_render"], name, repairs)
    return mesh, ReducedModel(**{field: made[field] for field in MODEL})
