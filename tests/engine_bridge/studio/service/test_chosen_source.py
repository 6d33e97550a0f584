"""The stages of the service file for a source."""

from types import SimpleNamespace

from engine_bridge.studio.service import chosen_source


def test_a_recording_moves_each_character_and_a_video_that_is_tracked_once_is_one_stage(tmp_path):
    both = [SimpleNamespace(name=name, live_file=tmp_path / name / "live.toml") for name in ("cat", "dog")]
    tables = [{"puppet": f"{name}/live.toml", "name": name} for name in ("cat", "dog")]
    video = chosen_source.video(tmp_path / "dance.mp4", "my dance.mp4", loop=True)
    assert (video.state.kind, video.state.name, video.state.uri) == ("upload", "my dance.mp4", "video:my dance.mp4")
    assert chosen_source.stages(both, video, tmp_path) == [
        {"source": f"video:{tmp_path}/dance.mp4?loop", "name": "stage", "calibrate": "at_once", "character": tables}
    ]
    walk = chosen_source.example("walk")
    rest = {"source": "demo:walk?loop", "calibrate": "at_once", "sound": "default"}
    assert chosen_source.stages(both, walk, tmp_path, "default") == [
        {"name": table["name"], "character": [table], **rest} for table in tables
    ]
    assert chosen_source.stages([], video, tmp_path) == []
