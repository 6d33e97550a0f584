import json

import pytest
from click.testing import CliRunner

from engine_bridge.cli.main import main
from engine_bridge.inspection.finding import Finding


@pytest.mark.slow
def test_doctor_prints_json(tmp_path):
    arguments = ["doctor", "--json", "--source", "demo:walk", "--source", "demo:nobody", "--takes", str(tmp_path)]
    result = CliRunner().invoke(main, arguments)
    findings = json.loads(result.stdout)
    assert {"name", "ok", "detail", "fix"} == findings[0].keys()
    assert {"demo:walk": True, "demo:nobody": False, "takes": True}.items() <= {
        each["name"]: each["ok"] for each in findings
    }.items()
    assert result.exit_code == 1


@pytest.mark.parametrize(("states", "code"), [((True, None), 0), ((True, None, False), 1)])
def test_only_a_failed_check_sets_the_exit_code(monkeypatch, states, code):
    findings = [Finding(f"thing {k}", ok, "found", "Do it.") for k, ok in enumerate(states)]
    monkeypatch.setattr("engine_bridge.inspection.machine.examine", lambda _takes, _sources: findings)
    result = CliRunner().invoke(main, ["doctor"])
    assert result.exit_code == code
    assert [line[:2] for line in result.stdout.splitlines()[::2]] == ["ok", "--", "!!"][: len(states)]
