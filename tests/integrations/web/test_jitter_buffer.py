"""The buffer of the JavaScript client shows what its source had at the time of its delay."""

import json
import subprocess
from pathlib import Path

MODULE = Path(__file__).parents[3] / "integrations" / "web" / "jitter-buffer.js"

PROGRAM = """
const { JitterBuffer } = await import(process.argv[1]);
const [delay, rate, seconds] = process.argv.slice(2).map(Number);
const buffer = new JitterBuffer(delay);
for (let n = 0; n <= rate * seconds; n++) {
  buffer.push({ header: { time: 7 + n / rate, sequence: n } }, n / rate);
  buffer.advance(n / rate);
}
console.log(JSON.stringify([buffer.earlier.header.sequence, buffer.share, buffer.lost]));
"""


def test_a_second_of_a_fast_source_can_wait(node):
    """240 frames per second with a delay of one second: shown at 4 s is what the source had at 3 s, frame 720."""
    command = ["node", "--input-type=module", "-e", PROGRAM, MODULE.as_uri(), "1", "240", "4"]
    shown = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert abs(shown[0] + shown[1] - 720) < 1e-6
    assert shown[2] == 0
