extends RefCounted
## Client of a service's control socket (docs/control.md). Each request gets one reply: from the service or, if that
## does not answer, an error of the same form from this client. The owner calls [method poll] in each process frame.

const Connection := preload("connection.gd")
const Connections := preload("connections.gd")

## Maximum time to a reply, in seconds.
const REPLY_TIMEOUT_SECONDS := 5.0
## Maximum time to the reply to `play_take`, which comes when the motion of the take has been computed, in seconds.
const TAKE_TIMEOUT_SECONDS := 120.0
## Maximum number of sent requests without a reply. Further requests wait until replies arrive.
const MAX_PENDING_REQUESTS := 16
## Maximum size of a reply, in bytes.
const MAX_REPLY_BYTES := 1 << 24

var host: String
var port: int

var _connection: Connection
var _pending: Dictionary = {}  # id: _Request
var _next_id := 1


class _Request:
	var body: PackedByteArray
	var done: Callable
	var timeout_seconds := REPLY_TIMEOUT_SECONDS
	var deadline_ms: int
	var sent := false


func _init(to_host: String, to_port: int, token := "") -> void:
	host = to_host
	port = to_port
	_connection = Connections.make(to_host, "DEALER", token)
	_connection.max_message_bytes = MAX_REPLY_BYTES


## Send a request, for example `{"do": "mirror", "character": "dog", "on": true}`. A later [method poll] calls [param
## done] with the reply: `{"ok": true, "result": …}`, or `{"ok": false, "error": {"where", "found", "expected",
## "fix"}}`.
func request(body: Dictionary, done: Callable) -> void:
	var made := _Request.new()
	made.body = JSON.stringify(body.merged({"id": _next_id}, true)).to_utf8_buffer()
	made.done = done
	made.timeout_seconds = TAKE_TIMEOUT_SECONDS if body.get("do") == "play_take" else REPLY_TIMEOUT_SECONDS
	made.deadline_ms = Connection.now_ms() + int(1000 * made.timeout_seconds)
	_pending[_next_id] = made
	_next_id += 1


## Connect if there are requests, send them, and call the callbacks of the replies that have arrived.
func poll() -> void:
	if _pending.is_empty() and _connection.state == Connection.State.CLOSED:
		return
	_connection.poll()
	match _connection.state:
		Connection.State.CLOSED:
			_connection.open(host, port)
		Connection.State.READY:
			_send()
			_take_replies()
		Connection.State.REFUSED, Connection.State.FAILED:
			_take_replies()
			fail_all("no connection (%s)" % _connection.reason.trim_suffix("."))
	_fail_late_requests()


## Close the connection, and reply to all pending requests with an error that gives the reason.
func fail_all(reason: String) -> void:
	_connection.close()
	for id: int in _pending.keys():
		if id in _pending:  # a callback may have closed this client
			_fail(id, reason, "a connection to the control socket")


## Close the connection. Callbacks of pending requests are not called any more.
func close() -> void:
	_connection.close()
	_pending.clear()


func _send() -> void:
	for id: int in _pending.keys().slice(0, MAX_PENDING_REQUESTS):  # in the order of the requests
		var each: _Request = _pending[id]
		if not each.sent:
			each.sent = true
			_connection.send(each.body)


func _take_replies() -> void:
	for bytes in _connection.take():
		var reader := JSON.new()
		if reader.parse(bytes.get_string_from_utf8()) != OK or not reader.data is Dictionary:
			continue
		var reply: Dictionary = reader.data
		var id: Variant = reply.get("id")
		if id is float and reply.get("ok") is bool and int(id) in _pending:
			_answer(int(id), reply)


func _fail_late_requests() -> void:
	var now := Connection.now_ms()
	for id: int in _pending.keys():
		if id in _pending and now > _pending[id].deadline_ms:
			_fail(id, "no reply within %d s" % _pending[id].timeout_seconds, "a reply")
			# The connection may be dead without an error, so it is not used again.
			_connection.close()


func _fail(id: int, found: String, expected: String) -> void:
	var where := "the control socket, %s" % Connections.address(host, port)
	var fix := "Check that the service is running and that its control socket has this address."
	var error := {"where": where, "found": found, "expected": expected, "fix": fix}
	_answer(id, {"id": id, "ok": false, "error": error})


func _answer(id: int, reply: Dictionary) -> void:
	var done: Callable = _pending[id].done
	_pending.erase(id)
	if done.is_valid():
		done.call(reply)
