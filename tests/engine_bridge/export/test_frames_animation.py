from engine_bridge.export import frames_animation
from engine_bridge.export.convert import convert
from engine_bridge.export.frames_animation import check_size
from engine_bridge.performance.settings import Settings
from puppetline.errors import OutputError

from ..refusals import refused


def test_a_cache_that_no_player_could_hold_is_refused_with_a_rate_that_fits(exported, tmp_path, monkeypatch):
    export, output = exported("textured", "frames"), tmp_path / "out.glb"
    size, character = export.summary.bytes, export.clip.motion.prepared.character
    for share in (1.1, 0.9):  # the size that is reckoned with is that of the file
        monkeypatch.setattr(frames_animation, "MAX_CACHE_BYTES", int(size * share))
        if share > 1:
            check_size(output, character, 58, 30)
    fix = refused(OutputError, check_size, output, character, 580, 30).fix
    slower = float(fix.partition("--fps ")[2].partition(",")[0])
    check_size(output, character, int(580 * slower / 30), slower)
    refused(OutputError, check_size, output, character, int(580 * (slower + 0.3) / 30), slower + 0.3)


def test_a_vertex_cache_that_is_refused_computes_no_frame(blob_puppet, take, tmp_path, monkeypatch):
    monkeypatch.setattr(frames_animation, "MAX_CACHE_BYTES", 1_000_000)
    stages, output = [], tmp_path / "out.glb"
    refused(
        OutputError, convert, take, blob_puppet, output, Settings(form="frames"), lambda name, _: stages.append(name)
    )
    assert set(stages) == {"Preparing the character"}
    assert not output.exists()
