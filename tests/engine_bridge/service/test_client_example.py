"""The example client of the wire protocol against the real command, and that against the solver."""

import re
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine_bridge.export.live_basis import LiveBasis
from engine_bridge.performance.rig import load_rig
from engine_bridge.service.players.character_player import CharacterPlayer, PlayerSettings
from engine_bridge.service.protocol.frame import StreamedCharacter
from engine_bridge.service.stages.stage import Stage, StageSettings
from engine_bridge.service.stages.stage_runner import StageRunner
from engine_bridge.service.states import STATES

from ...conftest import ROOT
from ...modules import load

SAID = re.compile(r"frame (?P<frame>\d+), (?P<state>\w+), \d+ fps, \[(?P<low>[-.e\d ]+)\] to \[(?P<high>[-.e\d ]+)\]\n")

pytestmark = pytest.mark.slow

BEFORE_THE_END = 0.5
"""Seconds: what comes last may be dropped."""


@pytest.fixture(scope="module")
def follow():
    return load("examples/clients/follow.py").follow


@pytest.fixture(scope="module")
def targets(baked):
    return load("examples/clients/morph_targets.py").read_targets(baked)


@pytest.fixture(scope="module")
def puppet(blob, new_glb, write_puppet, tmp_path_factory):
    """A puppet of the figure in two parts, one of them turned and stretched, shown in another order than stored."""
    glb, turn, stretch = new_glb(), Rotation.from_rotvec([0.4, -1.0, 0.3]), np.array([0.5, 2.0, 3.0])
    upper = blob.vertices[blob.faces].mean(axis=1)[:, 1] > 0.2
    above = glb.node()
    for faces, linear, more in (
        (blob.faces[upper], np.eye(3), {}),
        (blob.faces[~upper], turn.as_matrix() * stretch, {"rotation": turn.as_quat().tolist(), "scale": [*stretch]}),
    ):
        kept, corners = np.unique(faces, return_inverse=True)
        normals = blob.normals[kept] @ linear
        normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
        positions = blob.vertices[kept] @ np.linalg.inv(linear).T
        glb.node(glb.mesh(glb.primitive(positions, corners.astype(np.uint32), NORMAL=normals)), above, **more)
    glb.file.nodes[above].children.reverse()
    mesh = glb.save(tmp_path_factory.mktemp("parts") / "parts.glb")
    return write_puppet(mesh.with_name("parts.toml"), mesh.name)


@pytest.fixture(scope="module")
def baked(puppet, take, commands):
    """A morph basis of another motion than what is played: it leaves something of most poses."""
    path = puppet.with_name("parts.morphs.glb")
    commands.run("bake", puppet, "-o", path, "--log", take, "--tolerance", "0.001").check_returncode()
    return path


@pytest.fixture(scope="module")
def log(puppet, record_events, kung_fu):
    return record_events(puppet.with_name("played.log"), kung_fu)


@pytest.fixture
def line(puppet, baked, log, executor):
    """The same recording, played here."""
    rig = load_rig(puppet)
    player = CharacterPlayer(
        StreamedCharacter("parts", rig, 1, LiveBasis.load(baked, rig)), PlayerSettings(calibrate="at_once"), executor
    )
    playing = StageRunner(f"replay:{log}", Stage("stage", [player], StageSettings()), log.parent)
    yield playing
    playing.close()


def play(line, until):
    """Return the solver's frames by their numbers."""
    frames = []
    while not frames or frames[-1].time < until:
        time.sleep(max(0.0, line.due() - time.monotonic()))
        frames += line.take_in()
    return {frame.sequence: frame for frame in frames}


def collect(frames, until):
    """Keep a client's frames until a moment of the recording."""
    kept = []
    for header, *arrays in frames:
        kept.append((header, *arrays))
        if header.time >= until:
            frames.close()
    return kept


def test_all_three_modes_show_what_the_solver_has(serve, follow, puppet, baked, targets, log, line, kung_fu):
    service = serve("--puppet", puppet, "--source", f"replay:{log}", "--morphs", baked, "--calibrate", "at_once")
    following = [follow(service.stream, "parts", mode, targets=targets) for mode in ("controls", "vertices", "morphs")]
    with ThreadPoolExecutor(3) as pool:
        collected = pool.map(collect, following, [kung_fu[-1].time - BEFORE_THE_END] * 3)
        solved = play(line, kung_fu[-1].time)
        controls, vertices, morphs = collected
    for kept in (controls, vertices, morphs):
        assert sum(STATES[header.state] == "performing" for header, *_ in kept) > 100
        for header, *_ in kept:
            frame = solved[header.sequence]
            assert (header.time, STATES[header.state], header.user) == (frame.time, frame.state, frame.user)
            np.testing.assert_array_equal(header[-3:], frame.root.astype(np.float32))
    diagonal = next(iter(solved.values())).character.rig.mesh.diagonal
    for header, *shown in controls + vertices:
        (positions, normals), (expected, expected_normals) = shown, solved[header.sequence].vertices_and_normals
        assert np.linalg.norm(positions - expected, axis=1).max() <= 1e-5 * diagonal
        assert np.linalg.norm(normals - expected_normals, axis=1).max() <= 1e-5
    left = []
    for header, positions, _ in morphs:
        frame = solved[header.sequence]
        once = np.unique(frame.character.rig.mesh.of_render, return_index=True)[1]
        away = np.linalg.norm(positions - frame.vertices_and_normals[0], axis=1)[once] / diagonal
        left.append(np.sqrt(np.mean(away**2)))
        assert left[-1] == pytest.approx(frame.morphs.residual, rel=1e-3, abs=1e-6)
    assert max(left) > 1e-3  # it was another motion


def test_as_a_program_it_says_once_a_second_what_it_sees(serve, puppet, sender, tmp_path):
    token = tmp_path / "token"
    token.write_text("correct-horse-battery-staple")
    token.chmod(0o600)
    service = serve("--puppet", puppet, "--source", sender.uri, "--token-file", token)
    client = ROOT / "examples" / "clients" / "follow.py"
    command = [sys.executable, "-u", client, "parts", "vertices", "--address", service.stream]
    with subprocess.Popen([*command, "--token", token.read_text()], stdout=subprocess.PIPE, text=True) as program:
        found = [SAID.fullmatch(program.stdout.readline()) for _ in range(3)]
        program.terminate()
    numbers = [int(line["frame"]) for line in found]
    assert numbers == sorted(set(numbers))
    rest = load_rig(puppet).character.vertices
    for line in found:
        assert line["state"] == "waiting"  # for nobody is there
        for corner, expected in (("low", rest.min(axis=0)), ("high", rest.max(axis=0))):
            np.testing.assert_allclose([float(number) for number in line[corner].split()], expected, atol=1e-3)
