import subprocess
from pathlib import Path

import pytest

PEERS = Path(__file__).parents[2] / "peers"


@pytest.fixture
def node_program(node):
    """Run a program of tests/peers with node; fail with what it prints."""

    def run(program, *arguments):
        done = subprocess.run(
            ["node", PEERS / program, *map(str, arguments)], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr

    return run
