from ...terminal import Terminal


def test_a_terminal_shows_rate_and_time_left_and_a_pipe_nothing(commands, take, blob_puppet, tmp_path):
    arguments = ["batch", take, "--puppet", blob_puppet, "-o", "out", "--workers", 0, "--no-report"]
    arguments += ["--manifest", "m.csv"]
    terminal = Terminal(commands, *arguments, cwd=tmp_path)
    assert terminal.end() == 0
    assert "1/1 · " in terminal.heard
    assert " per hour" in terminal.heard
    terminal.close()
    (tmp_path / "out" / "blob" / "dance.glb").unlink()
    piped = commands.run(*arguments, cwd=tmp_path)
    assert piped.returncode == 0
    assert piped.stderr == ""
    assert piped.stdout.count("\n") == 2
