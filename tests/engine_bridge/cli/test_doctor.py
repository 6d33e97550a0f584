import json
from dataclasses import asdict
from unittest.mock import Mock

import pytest

from engine_bridge.inspection.finding import Finding


@pytest.mark.parametrize(("states", "code"), [((True, None), 0), ((True, None, False), 1)])
def test_only_a_failed_check_sets_the_exit_code(invoke, monkeypatch, tmp_path, states, code):
    findings = [Finding(f"thing {k}", ok, "found", "Do it.") for k, ok in enumerate(states)]
    examine = Mock(return_value=findings)
    monkeypatch.setattr("engine_bridge.inspection.machine.examine", examine)
    lines = invoke("doctor", "--source", "demo:walk", "--takes", tmp_path, code=code).stdout.splitlines()
    examine.assert_called_once_with(tmp_path, ("demo:walk",))
    assert [line[:2] for line in lines[::2]] == ["ok", "--", "!!"][: len(states)]
    assert json.loads(invoke("doctor", "--json", code=code).stdout) == [asdict(each) for each in findings]
