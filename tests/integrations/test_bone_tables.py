"""The clients' tables of names of bones are those of `capture`."""

import runpy
from pathlib import Path

SCRIPT = Path(__file__).parents[2] / "integrations" / "write_bone_tables.py"


def test_the_clients_have_the_table_of_capture():
    """If they do not, call `make bone-tables`."""
    files = runpy.run_path(str(SCRIPT))["client_files"]()
    assert len(files) == 3
    assert {path: path.read_text(encoding="utf-8") for path in files} == files
