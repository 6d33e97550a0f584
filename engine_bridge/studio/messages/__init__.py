"""The messages of the WebSocket ``/api``: requests, their results, and events that the server pushes.

The client's first text frame is `Hello`. The server answers with `Greeting` and a state, or closes the
connection with a `CloseCode`. From then on, the client sends requests, each of which is a JSON map::

    {"id": 7, "do": "edit", "character": "dragon", "puppet": {…}}

`id` is an integer that the reply repeats. The reply is one of these::

    {"id": 7, "ok": true, "result": {…}}
    {"id": 7, "ok": false, "error": {"where": "…", "found": "…", "expected": "…", "fix": "…"}}

Some requests start a job and wait for it. While it runs, it is in `State.jobs` with its progress. The reply comes when
it is done, with its id as ``job`` in the result; it is an error if the job has failed or was cancelled.

Between replies, the server pushes events, which have the key ``event`` instead of ``id``: ``{"event": "state", "state":
{…}}`` at most ten times per second after a change, and `ProgressEvent`. Replies come in the order in which the work
ends. Unknown keys of a request are errors. Clients ignore keys that they do not know.

``POST /uploads?name=FILE`` with the file as the body answers ``{"upload", "kind", "name", "facts"}``. A refused upload
has status 400, 401, 403, 413 or 507, and the body ``{"error": {where, found, expected, fix}}``.

Points are in the coordinates of the mesh file, as in the puppet file. Names of joints are those of
`capture.skeleton.JOINTS`. Characters have names of up to 32 letters, digits, `_` and `-`.
"""
