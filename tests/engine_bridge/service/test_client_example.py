"""The example client of the wire protocol as a program; tests/examples/test_clients.py has what it shows."""

import re
import subprocess
import sys

import numpy as np
import pytest

from engine_bridge.performance.prepared_character import load_prepared

from ...conftest import ROOT

SAID = re.compile(r"frame (?P<frame>\d+), (?P<state>\w+), \d+ fps, \[(?P<low>[-.e\d ]+)\] to \[(?P<high>[-.e\d ]+)\]\n")

pytestmark = pytest.mark.slow


def test_as_a_program_it_says_once_a_second_what_it_sees(serve, blob_puppet, sender, tmp_path):
    token = tmp_path / "token"
    token.write_text("correct-horse-battery-staple")
    token.chmod(0o600)
    service = serve("--puppet", blob_puppet, "--source", sender.uri, "--token-file", token)
    client = ROOT / "examples" / "clients" / "follow.py"
    command = [sys.executable, "-u", client, "blob", "vertices", "--address", service.stream]
    with subprocess.Popen([*command, "--token", token.read_text()], stdout=subprocess.PIPE, text=True) as program:
        found = [SAID.fullmatch(program.stdout.readline()) for _ in range(3)]
        program.terminate()
    numbers = [int(line["frame"]) for line in found]
    assert numbers == sorted(set(numbers))
    rest = load_prepared(blob_puppet).character.vertices
    for line in found:
        assert line["state"] == "waiting"  # for nobody is there
        for corner, expected in (("low", rest.min(axis=0)), ("high", rest.max(axis=0))):
            np.testing.assert_allclose([float(number) for number in line[corner].split()], expected, atol=1e-3)
