"""The key of screens."""

import pytest

from engine_bridge.studio.screen.screen_key import ScreenKey


@pytest.mark.parametrize("token", ["", "wrong", "é", "\ud800"])
def test_only_the_key_opens(tmp_path, token):
    key = ScreenKey(tmp_path / "screen-key")
    assert ScreenKey(tmp_path / "screen-key").opens(key.text)  # also after a restart
    assert not key.opens(token)
