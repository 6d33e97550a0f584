"""The importer, the inspector and the package's own tests, with stand-ins for Unity's editor and NUnit."""

import pytest

from engine_bridge.service.protocol.clip_file import read_clip
from engine_bridge.service.protocol.payloads import decode

from ...recorded import decoded, recorded
from .conftest import PACKAGE

WORM = PACKAGE / "Tests" / "Editor" / "worm.clip"


@pytest.fixture
def edit(start):
    """Run the package's tests, and import a file; return everything that was said."""

    def run(file):
        return start("Editing", PACKAGE, file).finish()

    return run


def test_the_clip_of_the_tests_is_made_of_the_recorded_messages():
    _, scene, *frames = read_clip(WORM.read_bytes())
    expected = decode(recorded("scene"))
    assert scene.header.revision == expected.header.revision
    assert scene.body.facts == expected.body.facts
    for number, frame in enumerate(frames):
        assert (frame.body == decoded(f"{number}.controls")).all()


def test_the_packages_own_tests_pass_and_its_clip_is_imported(edit):
    *passed, imported, status = edit(WORM)
    assert [each["passed"] for each in passed] == [
        "ClipFilesAreImported",
        "PosesBetweenFramesAreMixed",
        "TheShaderIsSupported",
    ]
    assert imported == {"imported": "worm", "error": ""}
    assert status == {"status": "Info: Clip worm\nworm, 162 vertices, graphics card, no performer"}


def test_a_damaged_clip_is_an_error_of_the_import(edit, tmp_path):
    damaged = tmp_path / "damaged.clip"
    damaged.write_bytes(WORM.read_bytes()[:-1])
    *_, imported, status = edit(damaged)
    assert imported["error"].startswith("Puppetline: damaged: found a clip that is damaged at byte")
    assert status["status"].startswith("Warning: Clip damaged\ndamaged: found a clip that is damaged at byte")
