"""Convert every log of a folder with several puppets and print one row for each.

python -m benchmarks.real_logs LOGS PUPPET.toml [PUPPET.toml …]
"""

import sys
import tempfile
import time
from pathlib import Path

from engine_bridge.export.convert import convert
from engine_bridge.performance.settings import Settings
from puppetline.errors import PuppetlineError

HEADER = """| log | puppet | frames | targets | largest error | stretch p1 | p50 | p99 | seconds |
| --- | --- | --- | --- | --- | --- | --- | --- | --- |"""


def main() -> None:
    folder, *puppets = map(Path, sys.argv[1:])
    print(HEADER)
    with tempfile.TemporaryDirectory() as scratch:
        for log in sorted(path for path in folder.rglob("*") if path.is_file()):
            for puppet in puppets:
                start = time.perf_counter()
                place = f"| {log.relative_to(folder)} | {puppet.stem} "
                try:
                    _, found = convert(log, puppet, Path(scratch) / "out.glb", Settings())
                except PuppetlineError as error:
                    print(f"{place}| refused: {error.found} | | | | | | |", flush=True)
                    continue
                print(
                    f"{place}| {found.frames} | {found.targets} | {found.error:.2g} | {found.stretch_p1:.3f} "
                    f"| {found.stretch_p50:.3f} | {found.stretch_p99:.3f} | {time.perf_counter() - start:.1f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
