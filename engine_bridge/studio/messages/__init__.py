"""The messages of the WebSocket ``/api``: requests, their results, and events that the server pushes.

The client's first text frame is `Hello`. The server answers with `Greeting` and a `StateEvent`, or closes the
connection with a `CloseCode`. From then on, the client sends requests, each of which is a JSON map::

    {"id": 7, "do": "edit", "character": "dragon", "puppet": {…}}

`id` is an integer that the reply repeats. The reply is one of these::

    {"id": 7, "ok": true, "result": {…}}
    {"id": 7, "ok": false, "error": {"where": "…", "found": "…", "expected": "…", "fix": "…"}}

Between replies, the server pushes events, which have the key ``event`` instead of ``id``. Replies come in the order in
which the work ends. Unknown keys of a request are errors. Clients ignore keys that they do not know.

Points are in the coordinates of the mesh file, as in the puppet file. Names of joints are those of
`capture.skeleton.JOINTS`. Characters have names of up to 32 letters, digits, `_` and `-`.
"""
