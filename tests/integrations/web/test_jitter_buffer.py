"""The buffer of the JavaScript client shows what its source had at the time of its delay."""

import json
import subprocess
from pathlib import Path

import pytest

from ..playback import NumberedPlayback

MODULE = Path(__file__).parents[3] / "integrations" / "web" / "jitter-buffer.js"

PROGRAM = """
const [, address, delay, steps] = process.argv;
const { JitterBuffer } = await import(address);
const buffer = new JitterBuffer(Number(delay));
const told = [];
for (const [now, sequence, time] of JSON.parse(steps)) {
  if (sequence !== undefined) {
    buffer.push({ header: { time, sequence } }, now);
  } else if (buffer.advance(now)) {
    const { earlier, later, share, lost } = buffer;
    told.push({ time: (1 - share) * earlier.header.time + share * later.header.time, lost });
  } else told.push({ time: null });
}
console.log(JSON.stringify(told));
"""


class TestJitterBuffer(NumberedPlayback):
    @pytest.fixture
    def play_back(self, node):
        def play(delay, steps):
            command = ["node", "--input-type=module", "-e", PROGRAM, MODULE.as_uri(), str(delay), json.dumps(steps)]
            return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)

        return play
