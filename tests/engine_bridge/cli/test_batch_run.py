from engine_bridge.cli.batch_run import Pace

from ...terminal import Terminal


def test_the_time_left_follows_from_the_sizes_of_the_recordings():
    pace = Pace([1000, 1000, 6000])
    pace.add(1000, failed=False)
    assert pace.describe(2.0) == "1,800 per hour · 0:00:14 left"
    pace.add(1000, failed=True)
    assert pace.describe(2000.0) == "4 per hour · 1:40:00 left · 1 failed"
    pace.add(6000, failed=False)
    assert pace.describe(8.0) == "1,350 per hour · 0:00:00 left · 1 failed"


def test_a_terminal_shows_rate_and_time_left_and_a_pipe_nothing(commands, take, blob_puppet, tmp_path):
    arguments = ["batch", take, "--puppet", blob_puppet, "-o", "out", "--workers", 0, "--no-report"]
    arguments += ["--manifest", "m.csv"]
    terminal = Terminal(commands, *arguments, cwd=tmp_path)
    assert terminal.end() == 0
    assert " per hour · 0:00:00 left" in terminal.heard
    terminal.close()
    (tmp_path / "out" / "blob" / "dance.glb").unlink()
    piped = commands.run(*arguments, cwd=tmp_path)
    assert (piped.returncode, piped.stderr, piped.stdout.count("\n")) == (0, "", 2)
