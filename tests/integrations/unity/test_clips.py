"""Clips in the package, without a service: compared with the solver's vertices."""

from dataclasses import replace

import numpy as np
import pytest

from engine_bridge.service.protocol.header import Header, Kind, join, split, topic, write_json

from ...recorded import recorded
from ..clips import assert_near, at_times, clip_of, damaged
from ..messages import SCENE, scene_message, taken_apart
from ..stage import FPS
from .conftest import array

UNITY = np.float32([-1, 1, 1])
FRAMES = (0, 7, 30, 57)


@pytest.fixture(scope="module")
def solved(solved):
    """The vertices of all frames in Unity's axes, and the diagonal."""
    return solved[0] * UNITY, solved[1]


@pytest.fixture
def play_clip(start, clip):
    """Play the clip, and another one, in steps; return what was shown after each, and everything that was said."""

    def run(*steps, first=clip, second=clip):
        said = start("Clips", first, second, *steps).finish()
        return [each for each in said if "position" in each], said

    return run


def positions(said):
    return array(said["vertices"], columns=6)[:, :3]


@pytest.fixture
def assert_shown(solved):
    return lambda shown, *expected: assert_near(map(positions, shown), expected, solved)


def warnings_of(said):
    return [each["warning"] for each in said if "warning" in each]


def test_frames_are_those_of_the_solver_and_in_between_their_mean(play_clip, solved, assert_shown):
    """Seeking again shows the same bytes; before the beginning and after the end, the nearest frame is shown."""
    vertices, diagonal = solved
    moments = (*(number / FPS for number in FRAMES), 7.5 / FPS, 7 / FPS, -3, 99)
    shown, said = play_clip(*(f"at:{moment}" for moment in moments))
    assert said[0] == {"loaded": "dancer"}
    assert_shown(shown, *FRAMES, vertices[[7, 8]].mean(axis=0), 7, 0, 57)
    assert shown[1]["vertices"] == shown[5]["vertices"]
    assert np.abs(vertices[30] - vertices[0]).max() > 0.005 * diagonal


def test_two_clips_are_mixed_linearly_and_a_cut_keeps_the_mesh(play_clip, solved, assert_shown):
    vertices, weights = solved[0], (0.0, 0.25, 1.0)
    blends = [f"blend:{7 / FPS}:{40 / FPS}:{weight}" for weight in weights]
    (one, other, *mixed), said = play_clip(f"at:{7 / FPS}", f"at:{40 / FPS}", *blends)
    (_, after), cut = play_clip("at:0", "swap", f"at:{30 / FPS}")
    assert_shown(mixed, *((1 - weight) * vertices[7] + weight * vertices[40] for weight in weights))
    for weight, each in zip(weights, mixed, strict=True):
        roots = (1 - weight) * np.array(one["root"]) + weight * np.array(other["root"])
        assert each["root"] == pytest.approx(roots, abs=1e-5)
    assert_shown([after], 30)
    assert [sum("loaded" in each for each in told) for told in (said, cut)] == [1, 1]


def test_it_plays_at_its_speed_and_begins_again(play_clip):
    shown, _ = play_clip("play:0", "play:0.5", "speed:2", "play:0.5", "play:0.5")
    assert [each["position"] for each in shown] == pytest.approx([0, 0.5, 1.5, 2.5 - 57 / FPS], abs=1e-5)
    shown, _ = play_clip("once", "play:1.5", "play:1.5", "speed:-1", "play:1", "play:1")
    assert [each["position"] for each in shown] == pytest.approx([1.5, 1.9, 0.9, 0], abs=1e-5)


def test_a_manual_clock_moves_it(play_clip):
    shown, _ = play_clip("clock:Manual", "play:0.5", "advance:0.25", "play:0.5", "advance:0.25")
    assert [each["position"] for each in shown] == pytest.approx([0, 0.25, 0.25, 0.5])
    _, said = play_clip("advance:0.25")
    assert len(warnings_of(said)) == 1


def test_a_damaged_clip_is_a_warning(play_clip, danced, tmp_path):
    for what, content in damaged(danced).items():
        path = tmp_path / "damaged.clip"
        path.write_bytes(content)
        shown, said = play_clip("at:0", "play:1", first=path)
        assert len(warnings_of(said)) == 1, what
        assert {each["vertices"] for each in shown} == {""}, what


def test_a_pause_in_a_recording_is_a_pause_in_its_clip(play_clip, danced, tmp_path, solved, assert_shown):
    """Frames have times of their own, from any beginning."""
    paused = tmp_path / "paused.clip"
    paused.write_bytes(clip_of(at_times(danced, lambda number: 100 + number / FPS + 2 * (number > 7))))
    moments = (7 / FPS, 7 / FPS + (2 + 1 / FPS) / 2, 2 + 30 / FPS, 99)
    shown, _ = play_clip(*(f"at:{moment}" for moment in moments), first=paused)
    assert_shown(shown, 7, solved[0][[7, 8]].mean(axis=0), 30, 57)


def test_a_clip_of_another_character_is_not_blended(play_clip, danced, tmp_path, assert_shown):
    other, character = tmp_path / "other.clip", replace(danced[0].character, revision=7)
    other.write_bytes(clip_of([replace(frame, character=character) for frame in danced]))
    shown, said = play_clip("blend:0.5:1.0:0.5", second=other)
    assert len(warnings_of(said)) == 1
    assert_shown(shown, 15)


def test_an_object_is_attached_to_a_clip(play_clip, solved):
    vertices, diagonal = solved
    _, said = play_clip(f"at:{7 / FPS}", "attach:5", f"blend:{7 / FPS}:{40 / FPS}:0.5", "attach:5", "attach:9")
    places = [each["attached"] for each in said if "attached" in each]
    mean = vertices[[7, 40]].mean(axis=0)
    assert np.abs(places - np.array([vertices[7][5], mean[5], mean[9]])).max() <= 1e-5 * diagonal


def test_timeline_mixes_what_overlaps_on_a_track_and_holds_the_pose_in_a_gap(play_clip, solved, assert_shown):
    weights = [(1.0, 0.0), (0.75, 0.25), (0.2, 0.2), (0.0, 0.5)]
    steps = (f"timeline:{7 / FPS}:{first}:{67 / FPS}:{second}" for first, second in weights)  # the second clip loops
    (*shown, gap), said = play_clip(*steps, "timeline:0:0:0:0")
    assert [each["duration"] for each in said if "duration" in each][:2] == pytest.approx([57 / FPS] * 2)
    shares = [second / (first + second) for first, second in weights]
    assert_shown(shown, *((1 - share) * solved[0][7] + share * solved[0][10] for share in shares))
    assert gap["vertices"] == shown[-1]["vertices"]
    assert warnings_of(said) == []


def test_timeline_changes_nothing_outside_of_play_mode(play_clip):
    (before, after), _ = play_clip("at:0.5", "editing", "timeline:1:1:0:0")
    assert (after["position"], after["vertices"]) == (before["position"], before["vertices"])


PLAIN = {
    "name": "paint",
    "base_color": [0.5, 0.25, 1.0, 0.75],
    "metallic": 0.25,
    "roughness": 0.75,
    "emissive": [0.5, 0, 2],
    "alpha_mode": "OPAQUE",
    "double_sided": False,
}


@pytest.fixture
def material(play_clip, tmp_path):
    """Return the material that the package makes of one of a file without colours at the vertices."""

    def of(**values):
        facts, arrays = taken_apart()
        del facts["arrays"]["colors"]
        facts["parts"][0]["material"] = PLAIN | values
        revision = split(SCENE).header.revision
        text = write_json({"character": "worm", "revision": revision, "frames": 1, "fps": FPS, "recording": ""})
        description = join(topic("worm", Kind.CLIP), Header(kind=Kind.CLIP, length=len(text), revision=revision), text)
        path = tmp_path / "painted.clip"
        path.write_bytes(description + scene_message(facts, arrays) + recorded("0.controls"))
        _, said = play_clip("materials", first=path)
        return next(each for each in said if "queue" in each)

    return of


def encoded(linear):
    """Return the sRGB value of a linear one."""
    return 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055


def test_a_material_has_the_colours_and_the_emission_of_the_file(material):
    made = material()
    assert made["_BaseColor"] == pytest.approx([encoded(0.5), encoded(0.25), 1, 0.75], abs=1e-6)
    assert made["_EmissionColor"] == pytest.approx([0.5, 0, 2, 1])  # Unity does not convert what may be brighter than 1
    assert (made["_VertexColors"], made["_Metallic"], made["_Smoothness"], made["_Cull"]) == (0, 0.25, 0.25, 2)
    assert (made["queue"], made["keywords"]) == (0, "")
    assert material(double_sided=True)["_Cull"] == 0


def test_alpha_modes_are_clipping_and_blending(material):
    clipped, blended = material(alpha_mode="MASK"), material(alpha_mode="BLEND")
    assert (clipped["queue"], clipped["keywords"], clipped["_AlphaClip"]) == (2450, "_ALPHATEST_ON", 1)
    assert "_SrcBlend" not in clipped
    assert (blended["queue"], blended["keywords"]) == (3000, "_SURFACE_TYPE_TRANSPARENT")
    assert (blended["_SrcBlend"], blended["_DstBlend"], blended["_ZWrite"]) == (5, 10, 0)
    assert (clipped["RenderType"], blended["RenderType"]) == ("TransparentCutout", "Transparent")


def test_a_voice_moves_the_rest_pose_on_the_graphics_card(play_clip, spoken, tmp_path):
    character, path = spoken[0].character, tmp_path / "talk.clip"
    path.write_bytes(clip_of(spoken))
    shown, _ = play_clip("materials", *(f"at:{time / 30}" for time in (0, 1, 1.5, 2, 0)), first=path, second=path)
    (down,) = character.displacements
    for told, voice in zip(shown[1:], (0, 0.4, 0.7, 1, 0), strict=True):
        np.testing.assert_allclose(positions(told), (character.rest + voice * down) * UNITY, atol=1e-5)
