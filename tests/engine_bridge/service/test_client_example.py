"""The example client of the wire protocol as a program; tests/examples/test_clients.py has what it shows."""

import re
import subprocess
import sys

import pytest
from numpy.testing import assert_allclose

from engine_bridge.service.security.credentials import make_token, read_token

from ...conftest import ROOT

SAID = re.compile(r"frame (?P<frame>\d+), (?P<state>\w+), \d+ fps, \[(?P<low>[-.e\d ]+)\] to \[(?P<high>[-.e\d ]+)\]\n")

pytestmark = pytest.mark.slow


def test_as_a_program_it_says_once_a_second_what_it_sees(serve, blob_puppet, blob, sender, tmp_path):
    token = tmp_path / "token"
    make_token(token)
    service = serve("--puppet", blob_puppet, "--source", sender.uri, "--token-file", token)
    client = ROOT / "examples" / "clients" / "follow.py"
    command = [sys.executable, "-u", client, "blob", "vertices", "--address", service.stream]
    with subprocess.Popen([*command, "--token", read_token(token)], stdout=subprocess.PIPE, text=True) as program:
        found = [SAID.fullmatch(program.stdout.readline()) for _ in range(3)]
        program.terminate()
    numbers = [int(line["frame"]) for line in found]
    assert numbers == sorted(set(numbers))
    for line in found:
        assert line["state"] == "waiting"  # for nobody is there
        corners = [[float(number) for number in line[corner].split()] for corner in ("low", "high")]
        assert_allclose(corners, [blob.vertices.min(axis=0), blob.vertices.max(axis=0)], atol=1e-3)
