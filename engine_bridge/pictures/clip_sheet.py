"""A contact sheet of a clip: frames of the character, each beside the performer at the same time."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import JOINT_INDEX, mirrored, to_character_axes
from engine_bridge.character.document_reader import load_document
from engine_bridge.character.evaluation import Evaluation
from engine_bridge.character.materials import preview_colors
from engine_bridge.performance.clip import Clip
from engine_bridge.performance.grounding import stands
from engine_bridge.performance.prepared_character import PreparedCharacter
from engine_bridge.pictures import stick_figure
from engine_bridge.pictures.contact_sheet import write_contact_sheet
from engine_bridge.pictures.mesh_picture import render
from engine_bridge.pictures.view import View
from solver.model.binding import Binding
from solver.motion.deformer import to_file_units

TILE_COUNT, COLUMN_COUNT = 12, 4
CHARACTER_SIZE, PERFORMER_SIZE = (320, 320), (180, 320)
"""Width and height of both halves of a tile, in pixels."""


def draw(
    clip: Clip, path: Path, title: str, progress: Callable[[float], None] = lambda _: None, *, file: Path | None = None
) -> None:
    """Draw evenly spaced frames of a clip, seen from the character's front left, as a PNG.

    Parameters
    ----------
    clip : Clip
    path : Path
    title : str
    progress : callable, optional
        Called with the share of the tiles that are drawn.
    file : Path, optional
        The .glb that was written of the clip, which is drawn as viewers show it; by default the solver's surface is.

    Raises
    ------
    OutputError
    """
    chosen = np.unique(np.linspace(0, len(clip.motion) - 1, min(TILE_COUNT, len(clip.motion))).astype(int))
    images = []
    if file is None:
        places = _solved(clip.motion.prepared, clip.motion.R[chosen], clip.motion.root[chosen])
    else:
        shown = Evaluation(load_document(file), clip.motion.prepared.character.parts)
        places = np.array([*shown.positions(clip.motion.times[chosen])])
    drawn = _draw(clip.motion.prepared, places, clip.motion.root[chosen], CHARACTER_SIZE)
    for performer, character in zip(_performer(clip, chosen), drawn, strict=True):
        images.append(np.hstack([performer, character]))
        progress(len(images) / len(chosen))
    labels = [f"{clip.motion.times[index]:.2f} s" for index in chosen]
    write_contact_sheet(images, labels, COLUMN_COUNT, path, title)


def _performer(clip: Clip, chosen: NDArray[np.int64]) -> list[NDArray[np.uint8]]:
    """Draw the recorded joints; the camera follows the hips."""
    joints = clip.positions[chosen]
    joints = to_character_axes(mirrored(joints) if clip.motion.prepared.puppet.retarget.mirror else joints)
    joints = joints - np.nan_to_num(joints[:, JOINT_INDEX["hip_center"], None])
    known = joints[np.isfinite(joints).all(axis=-1)]
    view = View.around(known if len(known) else np.zeros((1, 3)), size=PERFORMER_SIZE)
    return [stick_figure.draw(each, replace(view, radius=max(view.radius, 1e-6)), PERFORMER_SIZE) for each in joints]


def draw_character(
    prepared: PreparedCharacter, frames: NDArray[np.floating], root: NDArray[np.floating], size: tuple[int, int]
) -> list[NDArray[np.uint8]]:
    """Draw a character on its floor; the camera follows the root, so the character is large in each image.

    Parameters
    ----------
    prepared : PreparedCharacter
    frames : (n, 4m, 3) floating
        Control variables, model units.
    root : (n, 3) floating
        Translation of the root, mesh file's coordinates.
    size : tuple of int
        Width and height in pixels.

    Returns
    -------
    list of (h, w, 3) uint8
    """
    return _draw(prepared, _solved(prepared, frames, root), root, size)


def _solved(
    prepared: PreparedCharacter, frames: NDArray[np.floating], root: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Return the solved positions (n, N, 3) of all vertices, mesh file's coordinates."""
    binding = Binding.of_solver_mesh(prepared.model, prepared.mesh)
    solved = [
        binding.vertices(to_file_units(each, prepared.model)) + way for each, way in zip(frames, root, strict=True)
    ]
    return np.array(solved)[:, prepared.mesh.of_render]


def _draw(
    prepared: PreparedCharacter, places: NDArray[np.float64], root: NDArray[np.floating], size: tuple[int, int]
) -> list[NDArray[np.uint8]]:
    """Draw positions (n, N, 3) of all vertices; see `draw_character`."""
    basis = prepared.puppet.character.basis
    poses = places @ basis.T
    ways = root @ basis.T * [1, 0, 1]
    view = View.around(poses - ways[:, None], size=size)
    if stands(prepared.puppet):  # what hangs from a hand may be lower than the feet
        view = replace(view, ground=float((prepared.character.vertices @ basis[1]).min()))
    images, colors = [], preview_colors(prepared.character)
    for pose, way in zip(poses, ways, strict=True):
        along = replace(view, center=tuple(view.center + way))
        images.append(render(pose, prepared.character.triangles, along, size, colors))
    return images
