"""Writes the table of `capture/bone_names.toml` into the clients, which recognise the bones of a humanoid by it.

    python integrations/write_bone_tables.py

A convention has the names in the middle and those of a side, without decoration, in VRM's order; "-" for none.
"""

import json
import math
from pathlib import Path

from capture import bone_names

HERE = Path(__file__).parent
MADE = "Made by integrations/write_bone_tables.py from capture/bone_names.toml."

JAVASCRIPT = """// {made}

/**
 * @typedef {{object}} BoneTable
 * @property {{{{middle: string, sides: string, least: number}}[]}} conventions
 * @property {{string}} middle
 * @property {{string}} sides
 * @property {{Record<string, string>}} substitutes
 * @property {{Record<string, string>}} words
 * @property {{Record<string, string>}} fingers
 * @property {{string}} decoration
 * @property {{string}} controls
 * @property {{number}} sharedWordShare
 * @property {{number}} minSharingJoints
 */

/** @type {{BoneTable}} */
export const TABLE = {table};
"""
GDSCRIPT = 'extends RefCounted\n## {made}\n\n# gdlint: disable=max-line-length\nconst JSON_TEXT := """\n{table}\n"""\n'
CSHARP = """namespace Puppetline
{{
    /// <summary>{made}</summary>
    static class BoneTable
    {{
        public const string Text = @"{quoted}";
    }}
}}
"""
CLIENTS = {
    "web/bone-table.js": JAVASCRIPT,
    "godot/addons/puppetline/play/bone_table.gd": GDSCRIPT,
    "unity/Runtime/BoneTable.cs": CSHARP,
}
"""What is around the table in each client's file."""


def table() -> dict[str, object]:
    """Return the table, conventions with the same names once."""
    rows = ((False, bone_names.MIDDLE_PARTS), (True, bone_names.SIDE_PARTS))
    conventions = {}
    for parts in bone_names.CONVENTIONS.values():
        names = {(sided, part): name for (sided, name), part in parts.items()}
        middle, sides = (" ".join(names.get((sided, part), "-") for part in row) for sided, row in rows)
        conventions[middle, sides] = math.ceil(bone_names.least_names(parts))
    return {
        "conventions": [
            {"middle": middle, "sides": sides, "least": least} for (middle, sides), least in conventions.items()
        ],
        "middle": " ".join(bone_names.MIDDLE_PARTS),
        "sides": " ".join(bone_names.SIDE_PARTS),
        **{kind: bone_names.TABLE[kind] for kind in ("substitutes", "words", "fingers")},
        **bone_names.TABLE["other"],
        "sharedWordShare": bone_names.SHARED_WORD_SHARE,
        "minSharingJoints": bone_names.MIN_SHARING_JOINTS,
    }


def client_files() -> dict[Path, str]:
    """Return the text of each client's file."""
    text = json.dumps(table(), ensure_ascii=False, indent=2)
    quoted = text.replace('"', '""')
    return {HERE / name: around.format(made=MADE, table=text, quoted=quoted) for name, around in CLIENTS.items()}


if __name__ == "__main__":
    for path, text in client_files().items():
        path.write_text(text, encoding="utf-8")
