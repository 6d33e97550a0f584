"""The modules of the studio's page that need no document: edits of puppets, undo, picking, plots (page/test/*.ts)."""

import shutil
import subprocess

from ...conftest import ROOT, missing

PAGE = ROOT / "engine_bridge" / "studio" / "page"


def test_the_modules_do_what_their_own_tests_say():
    program = shutil.which("node")
    if program is None or not (PAGE / "node_modules" / "esbuild").is_dir():
        missing("node", "node or the packages of the page are not installed (make studio)")
    result = subprocess.run([str(program), PAGE / "test.mjs"], capture_output=True, text=True)
    assert result.returncode == 0, result.stdout
    passed = next(line for line in result.stdout.splitlines() if line.startswith(("# pass ", "ℹ pass ")))
    assert int(passed.split()[-1]) >= 33
