"""Requests of every client over the real control socket.

The tests of a client derive a class from `Requests`, and give it the fixture `ask`.
"""

PING = {"do": "ping"}


class Requests:
    """`ask` sends requests together to a port, perhaps with a token, and returns the replies as they come."""

    def test_each_request_gets_the_reply_that_python_gets_though_more_wait_than_are_sent(self, ask, figure):
        odd = 'no "such\\ \n ünicörn'
        first, listed, mirrored, chosen, wrong, unknown, *others = ask(
            figure.control_port,
            PING,
            {"do": "list"},
            {"do": "mirror", "character": "blob", "on": True},
            {"do": "choose_user", "character": "blob", "user": None},
            {"do": "choose_user", "character": odd, "user": 7},
            {"do": "pïng"},
            *({"do": "mirror", "character": "blob", "on": number % 3 == 0} for number in range(101)),
        )
        assert (first["ok"], first["result"]) == (True, "pong")
        assert listed["result"] == figure.ask("list")
        assert mirrored["result"]["mirror"] is True
        assert chosen["result"]["name"] == "blob"
        assert wrong["error"] == figure.ask("choose_user", character=odd, user=7)
        assert unknown["ok"] is False
        assert [each["result"]["mirror"] for each in others] == [number % 3 == 0 for number in range(101)]

    def test_without_a_service_or_its_token_every_request_is_told_so(self, ask, free_port, locked_figure, token_file):
        locked = locked_figure.control_port
        for port, token in ((free_port(), ""), (locked, "wrong"), (locked, "")):
            for reply in ask(port, PING, {"do": "list"}, token=token):
                assert (reply["ok"], f"127.0.0.1:{port}" in reply["error"]["where"]) == (False, True), reply
                assert reply["error"].keys() == {"where", "found", "expected", "fix"}
        [reply] = ask(locked, PING, token=token_file.read_text())
        assert reply["result"] == "pong"
