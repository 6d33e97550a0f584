"""A Puppet3D shows, in each mode, the solver's results for the same frames of the real service."""

import json
import threading
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial import cKDTree

from engine_bridge.character.examples import MOTIONS, prepare
from engine_bridge.performance.rig import load_rig
from engine_bridge.service.protocol.payloads import decode
from engine_bridge.service.protocol.scene import StreamedCharacter

from ...engine_bridge.export.conftest import Raw

CONTROLS, VERTICES, MORPHS = range(3)
SAMPLES = 20
APART = 6
"""Frames between two samples, so that the character has moved."""
NO_TURN = np.eye(3)
ALIKE = 1e-5
"""Of the diagonal: what positions may differ in f32. What is promised is 1e-4."""


@dataclass
class Frame:
    """What a Puppet3D says of a frame that it shows, and the positions of its vertices."""

    sequence: int
    next_sequence: int
    share: float
    positions: np.ndarray

    def came(self, values):
        """Tell whether both frames came here as well: on a busy machine the service leaves some out for a client."""
        return self.sequence in values and self.next_sequence in values

    def between(self, values):
        """Blend what has come with the two frames that this one lies between."""
        return (1 - self.share) * values[self.sequence] + self.share * values[self.next_sequence]


class Shown(NamedTuple):
    """Positions at rest, where a Puppet3D tells them, and what it shows."""

    rest: np.ndarray
    frames: list[Frame]


class Reference:
    """A puppet as the solver has it."""

    def __init__(self, puppet):
        self.rig = load_rig(puppet)
        self.diagonal = self.rig.mesh.diagonal
        self.rest = self.rig.character.vertices
        self._binding = StreamedCharacter(puppet.stem, self.rig, 1).binding
        steep = np.einsum("e,nex->nx", self.rig.model.weights, np.abs(self._binding._slopes))
        self.steepest = self.diagonal * np.linalg.norm(steep, axis=1).max()
        """By how many isolines places change at most over a diagonal along the surface."""

    def vertices_and_normals(self, controls):
        return self._binding.vertices_and_normals(controls.astype(np.float32))

    def positions(self, controls):
        return self.vertices_and_normals(controls)[0]

    def assert_moved(self, frames):
        """Make sure that there was something to see."""
        assert np.ptp([frame.positions for frame in frames], axis=0).max() > 0.01 * self.diagonal


@pytest.fixture
def show(start_godot, tmp_path):
    """Have Godot show a character of a service until it has told what it shows of some frames."""

    def run(port, vertices, **settings):
        file = tmp_path / "shown.bin"
        asked = {"settings": {"port": port, **settings}, "samples": SAMPLES, "apart": APART}
        script = start_godot("show_puppet.gd", json.dumps(asked | {"file": str(file)}))
        results = script.finish(300)
        rest, positions = np.split(np.fromfile(file, "<f4").reshape(-1, 3), [-SAMPLES * vertices])
        told = [each for each in results if "sequence" in each]
        frames = zip(told, np.split(positions, SAMPLES), strict=True)
        return Shown(rest, [Frame(t["sequence"], t["next_sequence"], t["share"], places) for t, places in frames])

    return run


@pytest.fixture
def shade(start_godot, read_pixels, tmp_path):
    """Have the graphics card show a character of a service, and read back what it computes."""

    def run(service, reference, samples, **settings):
        settings["port"] = service.port
        low, size = reference.rest.min(axis=0), np.ptp(reference.rest, axis=0)
        box = [(low - reference.diagonal).tolist(), (size + 2 * reference.diagonal).tolist()]
        asked = {"settings": settings, "samples": samples, "apart": 20, "box": box, "file": str(tmp_path / "pixels")}
        told = start_godot("shade_puppet.gd", json.dumps(asked), display=True).finish(600)
        told = [result for result in told if "sequence" in result]
        return list(zip(told, read_pixels(tmp_path / "pixels", samples, len(reference.rest), box), strict=True))

    return run


class Listener:
    """Keeps what a service says of a character while a test looks at it: messages by kind and sequence number."""

    def __init__(self, service, name, *kinds):
        self._client = service.client(*(f"{name}/{kind}" for kind in kinds))
        self._heard = {kind: {} for kind in kinds}
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._listen)

    def _listen(self):
        while not self._over.is_set():
            if self._client.socket.poll(100):
                message = decode(self._client.socket.recv())
                self._heard[message.topic.partition("/")[2]][message.header.sequence] = message

    def __enter__(self):
        self._thread.start()
        return tuple(self._heard.values())

    def __exit__(self, *_):
        self._over.set()
        self._thread.join()


def check_shader(shade, service, puppet, loosest=4.0, **settings):
    """Compare positions, normals and bounds of what is drawn."""
    reference = Reference(puppet)
    with Listener(service, puppet.stem, "controls") as (heard,):
        shown = shade(service, reference, 3, **settings)
    shown = [each for each in shown if {each[0]["sequence"], each[0]["next_sequence"]} <= heard.keys()]
    assert shown
    for told, (positions, normals, _) in shown:
        first, second = (heard[told[which]].body.astype(float) for which in ("sequence", "next_sequence"))
        between = (1 - told["share"]) * first + told["share"] * second
        lost = np.finfo(np.float32).eps * np.abs(between[..., :3]).max()  # where large transforms cancel out
        lost *= 1 + reference.steepest  # and normals add up their differences
        where, turned = reference.vertices_and_normals(between)
        assert np.abs(positions - where).max() <= ALIKE * reference.diagonal
        some = np.linalg.norm(turned, axis=1) > 0.5  # where there is no direction, the shader has to make one up
        assert np.abs(normals - turned)[some].max() <= 1e-4 + 10 * lost
        low, high = np.array(told["bounds"])
        assert (low - where.min(axis=0)).max() <= ALIKE * reference.diagonal
        assert (where.max(axis=0) - high).max() <= ALIKE * reference.diagonal
        assert np.prod(high - low) <= loosest * np.prod(np.ptp(where, axis=0))


@pytest.fixture(scope="session")
def puppetline(commands):
    return lambda *arguments: commands.run(*arguments).check_returncode()


def compared(frames, values):
    """Leave out what did not come here, as long as that is little."""
    kept = [frame for frame in frames if frame.came(values)]
    assert len(kept) >= 0.7 * len(frames)
    return kept


def check_controls(show, service, puppet, **settings):
    reference = Reference(puppet)
    with Listener(service, puppet.stem, "controls") as (heard,):
        frames = show(service.port, len(reference.rest), mode=CONTROLS, **settings).frames
    controls = {number: message.body.astype(float) for number, message in heard.items()}
    for frame in compared(frames, controls):
        expected = reference.positions(frame.between(controls))
        assert np.abs(frame.positions - expected).max() <= ALIKE * reference.diagonal
    reference.assert_moved(frames)
    assert any(0.1 < frame.share < 0.9 for frame in frames)


def check_vertices(show, service, puppet, mode=VERTICES, **settings):
    reference = Reference(puppet)
    with Listener(service, puppet.stem, "controls") as (controls,):
        frames = show(service.port, len(reference.rest), mode=mode, **settings).frames
    for frame in compared(frames, controls):
        expected = reference.positions(controls[frame.sequence].body)
        assert np.abs(frame.positions - expected).max() <= ALIKE * reference.diagonal
    reference.assert_moved(frames)


def check_morphs(show, service, puppet, source, offset=(0.0, 0.0, 0.0), to_file=NO_TURN, **settings):
    """Compare with the solver, of which morph targets leave as much as the service says."""
    reference = Reference(puppet)
    with Listener(service, puppet.stem, "controls", "morphs") as (heard, weights):
        shown = show(service.port, len(reference.rest), mode=MORPHS, mesh_source=source, **settings)
    # the importer has an order of its own
    near, number = cKDTree(reference.rest).query((shown.rest - offset) @ to_file)
    assert near.max() <= ALIKE * reference.diagonal
    once = np.unique(reference.rig.mesh.of_render[number], return_index=True)[1]
    controls = {number: message.body.astype(float) for number, message in heard.items()}
    left = {number: message.body.residual for number, message in weights.items()}
    for frame in compared(shown.frames, controls.keys() & left.keys()):
        away = (frame.positions - offset) @ to_file - reference.positions(frame.between(controls))[number]
        rms = np.sqrt((away[once] ** 2).sum(axis=1).mean()) / reference.diagonal
        assert rms <= max(left[frame.sequence], left[frame.next_sequence]) + ALIKE
    reference.assert_moved(shown.frames)


@pytest.fixture(scope="module")
def played(serve_module, blob_puppet, take):
    """A service that plays a recording to all tests that only look."""
    return serve_module("--puppet", blob_puppet, "--source", f"replay:{take}?loop", "--calibrate", "at_once")


def test_the_graphics_card_shows_the_same(shade, played, add_glb, blob_puppet, tmp_path, puppetline):
    puppetline("shader-mesh", blob_puppet, "-o", tmp_path / "own.glb")
    check_shader(shade, played, blob_puppet)
    check_shader(shade, played, blob_puppet, mesh_source=add_glb(tmp_path / "own.glb"))


def test_morphs_are_as_near_as_the_service_says_though_the_root_is_elsewhere_turned_and_scaled(
    show, playing, project, add_glb, blob_puppet, take, tmp_path, puppetline
):
    puppetline("bake", blob_puppet, "-o", tmp_path / "baked.glb", "--log", take)
    baked = add_glb(tmp_path / "baked.glb")
    (project / "moved.tscn").write_text(
        f'[gd_scene load_steps=2 format=3]\n[ext_resource type="PackedScene" path="{baked}" id="1"]\n'
        '[node name="Moved" instance=ExtResource("1")]\n'
        "transform = Transform3D(0, 0, 2, 0, 2, 0, -2, 0, 0, 0.5, -2, 1)\n"
    )
    service = playing(blob_puppet, take, "--morphs", tmp_path / "baked.glb")
    turned = np.array([[0, 0, 2], [0, 2, 0], [-2, 0, 0]])
    offset = (0.5, -2.0, 1.0)
    check_morphs(show, service, blob_puppet, "res://moved.tscn", offset, np.linalg.inv(turned).T)


def test_a_character_that_stays_in_its_place(show, played, blob_puppet):
    reference, service = Reference(blob_puppet), played
    for mode in CONTROLS, VERTICES:
        with Listener(service, "blob", "controls") as (messages,):
            frames = show(service.port, len(reference.rest), mode=mode, follow_root=False).frames
        controls = {number: message.body.astype(float) for number, message in messages.items()}
        roots = {number: np.array(message.header.root) for number, message in messages.items()}
        assert np.ptp([*roots.values()], axis=0).max() > 0.05 * reference.diagonal
        for frame in compared(frames, controls):
            frame.share *= mode == CONTROLS  # vertices are not blended
            expected = reference.positions(frame.between(controls)) - frame.between(roots)
            assert np.abs(frame.positions - expected).max() <= ALIKE * reference.diagonal


def test_more_fields_than_a_vertex_has_room_for_come_vertex_by_vertex(show, playing, blob_file, write_puppet, take):
    more = "[solver]\nfields = 9\nisolines = 6"
    puppet = write_puppet(blob_file.with_name("nine_fields.toml"), blob_file.name, more=more)
    check_vertices(show, playing(puppet, take), puppet, mode=CONTROLS)


def test_more_parts_than_a_mesh_has_room_for(show, shade, playing, blob, new_glb, write_puppet, take, tmp_path):
    glb = new_glb()
    pieces = [np.unique(faces, return_inverse=True) for faces in np.array_split(blob.faces, 300)]
    parts = [
        glb.primitive(blob.vertices[which], faces.astype(np.uint32), NORMAL=blob.normals[which].astype(np.float32))
        for which, faces in pieces
    ]
    glb.node(glb.mesh(*parts))
    puppet = write_puppet(tmp_path / "parts.toml", glb.save(tmp_path / "parts.glb").name)
    service = playing(puppet, take)
    check_shader(shade, service, puppet)
    check_vertices(show, service, puppet)


def keyframes(path):
    """Return the times and the vertices (T, n, 3) of what `puppetline convert --as frames` has written."""
    made = Raw(path)
    animation, primitive = made.file.animations[0], made.file.meshes[0].primitives[0]
    root = next(c.sampler for c in animation.channels if c.target.path == "translation")
    root = animation.samplers[root]
    targets = np.array([made.array(target["POSITION"]) for target in primitive.targets])
    moved = made.array(primitive.attributes.POSITION) + np.tensordot(made.weights(0), targets, 1)
    return made.array(root.input)[:, 0], moved + made.array(root.output)[:, None]


@pytest.mark.parametrize("mode", [CONTROLS, VERTICES])
def test_a_puppet_shows_what_convert_makes_of_the_same_performance(
    show, serve, blob_puppet, standing, dance, record, tmp_path, mode, puppetline
):
    """Who stands still, as the character does, until everything has settled is the same performer to both."""
    log = record(tmp_path / "take.log", np.concatenate([np.tile(standing, (90, 1, 1)), dance(400)]))
    puppetline("convert", log, "--puppet", blob_puppet, "-o", tmp_path / "frames.glb", "--as", "frames")
    times, vertices = keyframes(tmp_path / "frames.glb")
    (tmp_path / "service.toml").write_text(
        f'announce = false\ntakes = "{tmp_path / "takes"}"\n[network]\nport = 0\n'
        f'[[stage]]\nsource = "replay:{log}"\ntilt = 0.0\nheight = 0.0\n[[stage.character]]\npuppet = "{blob_puppet}"\n'
    )
    service = serve("--config", tmp_path / "service.toml")
    reference = Reference(blob_puppet)
    with Listener(service, "blob", "controls") as (heard,):
        frames = show(service.port, len(reference.rest), mode=mode).frames
    came_at = {number: message.header.time for number, message in heard.items()}
    converted = {number: vertices[np.abs(times - time).argmin()] for number, time in came_at.items()}
    kept = compared(frames, converted)
    for frame in kept:
        frame.share *= mode == CONTROLS  # vertices are not blended
        assert np.abs(frame.positions - frame.between(converted)).max() <= ALIKE * reference.diagonal
    assert sum(came_at[frame.sequence] > 3.1 for frame in kept) >= SAMPLES // 2


TEXTURED = ("khronos_Fox", "kaykit_Knight")
"""One of loose triangles, and one of fifteen parts, some of them on the bones of a skeleton."""


@pytest.fixture(scope="module", params=[*MOTIONS, *TEXTURED])
def character(request, own_cache, tmp_path_factory, puppetline):
    """One of the five example characters, or a textured one of somebody else's, and a performance: puppet, log."""
    folder = tmp_path_factory.mktemp(request.param)
    if request.param in MOTIONS:
        log, puppet = prepare(request.param, folder)
        return puppet, log
    mesh = request.getfixturevalue("real_data") / "mesh" / "gltf" / f"{request.param}.glb"
    puppet = folder / f"{request.param.rpartition('_')[2]}.toml"
    puppetline("new", mesh, "-o", puppet)
    return puppet, prepare("human", folder)[0]


@pytest.mark.slow
def test_characters_show_the_solvers_vertices_in_every_form(
    show, shade, playing, add_glb, character, tmp_path, puppetline
):
    puppet, log = character
    puppetline("bake", puppet, "-o", tmp_path / "baked.glb", "--log", log)
    puppetline("shader-mesh", puppet, "-o", tmp_path / "own.glb")
    service = playing(puppet, log, "--morphs", tmp_path / "baked.glb")
    own = add_glb(tmp_path / "own.glb")
    for settings in {}, {"mesh_source": own}:
        check_controls(show, service, puppet, **settings)
        check_shader(shade, service, puppet, **settings)
    check_vertices(show, service, puppet)
    check_morphs(show, service, puppet, add_glb(tmp_path / "baked.glb"))
