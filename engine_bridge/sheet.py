"""A contact sheet of a solved clip."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from engine_bridge.clip import Clip
from engine_bridge.preview import View, contact_sheet, render
from solver.binding import Binding
from solver.deformer import to_file_units

TILES = 12
COLUMNS = 4
TILE_SIZE = (320, 320)


def draw(clip: Clip, path: Path, title: str, progress: Callable[[float], None] = lambda _: None) -> None:
    """Draw evenly spaced moments of a clip from the character's front left into a PNG.

    Parameters
    ----------
    clip : Clip
    path : Path
    title : str
    progress : callable, optional
        Told the share of the tiles that are done.

    Raises
    ------
    OutputError
    """
    rig, basis = clip.rig, clip.rig.puppet.character.basis
    chosen = np.unique(np.linspace(0, len(clip.frames) - 1, min(TILES, len(clip.frames))).astype(int))
    binding = Binding.of_solver_mesh(rig.model, rig.mesh)
    solved = [binding.vertices(to_file_units(clip.frames[index], rig.model)) + clip.root[index] for index in chosen]
    poses = np.array(solved)[:, rig.mesh.of_render] @ basis.T
    carried = clip.root[chosen] @ basis.T
    view = View.around(poses - carried[:, None])
    images = []
    for pose, root in zip(poses, carried, strict=True):
        # the camera goes along with the root, or a performer who walks about would make the character small
        along = replace(view, center=tuple(view.center + root), ground=view.ground + root[1])
        images.append(render(pose, rig.character.triangles, along, TILE_SIZE, rig.character.colors))
        progress(len(images) / len(poses))
    labels = [f"{clip.timeline.times[index]:.2f} s" for index in chosen]
    contact_sheet(images, labels, COLUMNS, path, title)
