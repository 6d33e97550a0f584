"""Characters for programs: a mesh, its limbs or handles, and the performer's joints that move them."""

import os
import tempfile
from os import PathLike
from pathlib import Path
from typing import Any, get_args

import numpy as np
import tomlkit
from numpy.typing import NDArray

from engine_bridge.export.convert import convert_timeline
from engine_bridge.performance.channels import weights_at
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.performance.clip import TakeTimeline, reference_pose, timeline_of
from engine_bridge.performance.pose import Pose
from engine_bridge.performance.prepared_character import PreparedCharacter, load_prepared, make_prepared
from engine_bridge.performance.settings import Form, Settings
from engine_bridge.puppet import proposal, puppet_file
from engine_bridge.puppet.body_plans import BodyPlan
from engine_bridge.puppet.puppet import Direction, Puppet
from engine_bridge.service.protocol.scene import StreamedCharacter
from puppetline.errors import OutputError
from puppetline.files import check_one_of, check_writable
from puppetline.player import Player
from puppetline.recordings import Recording, load_recording

FILMS = ".mp4", ".webm", ".gif"
PERFORMERS = ".vrma", ".bvh"


class Character:
    """A mesh with its puppet, prepared for motion; `puppetline.propose` and `puppetline.load` make it.

    Attributes
    ----------
    puppet : Puppet
        Its limbs or handles, and the joints that move them (docs/puppet-file.md).
    mesh : Path
        The mesh file.
    notes : tuple of str
        Sentences about what was assumed and what is unclear.
    """

    def __init__(self, prepared: PreparedCharacter, notes: tuple[str, ...] = ()) -> None:
        self._prepared, self._drawn = prepared, StreamedCharacter("character", prepared, 0)
        self.puppet, self.mesh, self.notes = prepared.puppet, Path(prepared.character.document.name), notes

    @property
    def limbs(self) -> tuple[str, ...]:
        """Names of the limbs."""
        return tuple(limb.name for limb in self.puppet.limb)

    @property
    def handles(self) -> tuple[str, ...]:
        """Names of the handles."""
        return tuple(handle.name for handle in self.puppet.handle)

    @property
    def rest_vertices(self) -> NDArray[np.float64]:
        """(n, 3): vertices at rest, mesh file's coordinates."""
        return self._prepared.character.vertices

    @property
    def triangles(self) -> NDArray[Any]:
        """(k, 3) integers: rows of the vertices."""
        return self._prepared.character.triangles

    def motion(self, rest: "NDArray[np.float64] | Recording", *, mirror: bool | None = None) -> CharacterMotion:
        """Begin to follow a performer.

        Parameters
        ----------
        rest : (20, 3) float64 or Recording
            The performer's pose that corresponds to the character's rest pose, `Recording.rest_pose` for example. With
            a recording, the motion is that which `convert` writes.
        mirror : bool, optional
            Whether the character is the performer's mirror image; by default as in the puppet.

        Returns
        -------
        CharacterMotion
            Its ``step(frame)`` takes the performer's frames one after the other, and returns poses.
        """
        if isinstance(rest, Recording):
            timeline = rest.timeline()
            if mirror is None and isinstance(timeline, TakeTimeline):
                mirror = timeline.mirror
            rest = reference_pose(self.puppet, timeline, Settings())
        return CharacterMotion(self._prepared, np.asarray(rest, np.float64), mirror=mirror)

    def vertices(self, pose: Pose) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the vertices and normals of a pose.

        Returns
        -------
        vertices : (n, 3) float32
            Mesh file's coordinates, in the order of the file.
        normals : (n, 3) float32
            Unit vectors.
        """
        weights = weights_at(self.puppet, pose.channels)
        vertices, normals = self._drawn.vertices_and_normals(pose.controls, weights)
        return vertices, normals

    def convert(
        self, recording: "Recording | str | PathLike[str]", output: str | PathLike[str], **settings: Any
    ) -> Any:
        """Animate the character with a recording, and write a file.

        Parameters
        ----------
        recording : Recording or path
        output : path
            Its ending says what is written: ``.glb`` the animated character; ``.mp4``, ``.webm`` or ``.gif`` a film
            of it; ``.vrma`` or ``.bvh`` the performer's own motion, which other programs play on an avatar.
        **settings
            Fields of `engine_bridge.performance.settings.Settings`, for example ``fps=60`` or ``form="morph"``; the
            performer and how the file is read are those of the recording. Films have ``fps``, ``start`` and ``stop``.

        Returns
        -------
        object
            Summary of the file, a dataclass.

        Raises
        ------
        PuppetlineError
        """
        take = recording if isinstance(recording, Recording) else load_recording(recording)
        path, chosen = Path(output), Settings(**settings | {"user": take.user, "log": take.options})
        if chosen.form not in (None, *get_args(Form)):
            forms = ", ".join(get_args(Form))
            raise OutputError(path, found=f"the form {chosen.form!r}", expected=f"one of {forms}", fix="Correct it.")
        endings = (".glb", *FILMS, *PERFORMERS)
        fix = f"Call it {path.stem}.glb, for example."
        check_one_of(path, endings, f"one of {', '.join(endings)}", fix, inputs=(take.path, self.mesh))
        if path.suffix.lower() in PERFORMERS:
            from engine_bridge.export.performer.convert import convert_performers

            return convert_performers(take.path, path, chosen)[0]
        if path.suffix.lower() in FILMS:
            return self._film(take, path, chosen)
        timeline, notes = timeline_of(take.clips, take.path, chosen)
        return convert_timeline(self._prepared, timeline, path, take.path.stem, chosen, notes)[1]

    def show(self, recording: "Recording | str | PathLike[str]") -> Player:
        """Return the character as a recording moves it, to look at in a notebook or in a web page."""
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "shown.glb")
            self.convert(recording, file)
            return Player(file.read_bytes(), self.mesh.stem)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the puppet file, which can be edited, and read with `puppetline.load`.

        Raises
        ------
        OutputError
        """
        check_writable(Path(path), ".toml", inputs=(self.mesh,))
        puppet_file.dump(self._with_mesh(Path(os.path.relpath(self.mesh, Path(path).parent))), Path(path))

    def _with_mesh(self, mesh: Path) -> Puppet:
        table = self.puppet.character.model_copy(update={"mesh": mesh.as_posix()})
        return self.puppet.model_copy(update={"character": table})

    def _film(self, take: Recording, output: Path, settings: Settings) -> Any:
        """Write a film of the character alone, with the camera that follows it."""
        from engine_bridge.film.film import make_video

        used = Settings(user=settings.user, fps=settings.fps, start=settings.start, stop=settings.stop)
        if settings != used:
            raise OutputError(
                output,
                found="settings or options of a reader that a film does not have",
                expected="fps, start and stop at most",
                fix="Write a .glb, or use a scene file (docs/film.md).",
            )
        part = {"start": used.start} | ({} if used.stop is None else {"stop": used.stop})
        with tempfile.TemporaryDirectory() as folder:
            puppet, scene = Path(folder, "character.toml"), Path(folder, "scene.toml")
            puppet_file.dump(self._with_mesh(self.mesh.absolute()), puppet)
            tables = {
                "film": {"fps": used.fps},
                "character": [{"name": "it", "puppet": puppet.name}],
                "take": [{"character": "it", "file": str(take.path.absolute()), "user": take.user} | part],
                "camera": [{"shot": "follow"}],
            }
            scene.write_text(tomlkit.dumps(tables), encoding="utf-8")
            return make_video(scene, output, 0.0, None, False, lambda _stage, _share: None)

    def __repr__(self) -> str:
        counts = {"limbs": len(self.limbs), "handles": len(self.handles)}
        parts = ", ".join(f"{count} {what}" for what, count in counts.items() if count)
        return f"<puppetline.Character {self.mesh.name}: {parts}, {len(self.rest_vertices):,} vertices>"


def load(path: str | PathLike[str]) -> Character:
    """Load a puppet file and prepare its character.

    Raises
    ------
    PuppetlineError
    """
    return Character(load_prepared(Path(path)))


def propose(
    mesh: str | PathLike[str],
    *,
    body: int | None = None,
    up: Direction | None = None,
    front: Direction | None = None,
    turn: float | None = None,
    scale: float | None = None,
    plan: BodyPlan | None = None,
    mirror: bool = False,
) -> Character:
    """Propose limbs, or handles, for a mesh, and prepare it.

    Parameters
    ----------
    mesh : path
        A .glb, .gltf, .vrm, .obj, .off, .ply or .stl file.
    body : int, optional
        Number of the body that moves, if the mesh shows several; 0 for everything in the file. By default the first.
    up, front : "x", "-x", "y", "-y", "z" or "-z", optional
        Axes of the mesh that point up and forward; by default from its skeleton or shape.
    turn : float, optional
        Degrees by which the character is turned from `front` to its left; by default from its shape, or 0 if `front` is
        given.
    scale : float, optional
        Metres per unit of the mesh; by default from the character's height.
    plan : str, optional
        How limbs follow the performer, and which limbs are looked for in the shape: "upright", "two legs",
        "four legs", "many legs", "wings" or "no legs"; by default the likeliest.
    mirror : bool
        Whether the character is the performer's mirror image.

    Raises
    ------
    PuppetlineError
    """
    path = Path(mesh)
    made = proposal.new_puppet(
        path, path, body=body, up=up, front=front, turn=turn, scale=scale, plan=plan, mirror=mirror
    )
    return Character(make_prepared(made.puppet, made.character), (*made.assumed, *made.notes))
