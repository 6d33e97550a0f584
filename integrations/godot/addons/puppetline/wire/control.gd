extends RefCounted
## Requests to a service over its control socket (docs/control.md). Each gets one reply, from the service or, where that
## does not answer, from here in the same form. Whoever holds it calls [method poll] in each process frame.

const Connection := preload("zmtp_connection.gd")

## Seconds that a reply may take.
const PATIENCE := 5.0
## Requests that may be on their way; more wait here until there are replies.
const MOST_WAITING := 16
const LARGEST_REPLY := 1 << 24

var host: String
var port: int

var _connection: Connection
var _waiting: Dictionary = {}  # id: _Request
var _next_id := 1


class _Request:
	var body: PackedByteArray
	var done: Callable
	var give_up: int
	var sent := false


func _init(to_host: String, to_port: int, token := "") -> void:
	host = to_host
	port = to_port
	_connection = Connection.new("DEALER", token)
	_connection.largest_message = LARGEST_REPLY


## Ask for something, `{"do": "mirror", "character": "dog", "on": true}` say. [param done] is called with the reply in a
## later [method poll]: `{"ok": true, "result": …}`, or `{"ok": false, "error": {"where", "found", "expected", "fix"}}`.
func request(body: Dictionary, done: Callable) -> void:
	var made := _Request.new()
	made.body = JSON.stringify(body.merged({"id": _next_id}, true)).to_utf8_buffer()
	made.done = done
	made.give_up = Time.get_ticks_msec() + int(1000 * PATIENCE)
	_waiting[_next_id] = made
	_next_id += 1


## Do what there is to do now: connect where something is to be asked, send, and call back those who have a reply.
func poll() -> void:
	if _waiting.is_empty() and _connection.state == Connection.State.CLOSED:
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
			give_up(_connection.reason)
	_give_up_late_ones()


## Close, and call back those who wait for a reply at once: with an error that says why.
func give_up(why: String) -> void:
	_connection.close()
	for id: int in _waiting.keys():
		if id in _waiting:  # whoever has been called back may have closed all this
			_fail(id, why, "a connection to the control socket")


## Close; those who wait for a reply are not called back any more.
func close() -> void:
	_connection.close()
	_waiting.clear()


func _send() -> void:
	for id: int in _waiting.keys().slice(0, MOST_WAITING):  # which is the order of the requests
		var each: _Request = _waiting[id]
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
		if id is float and reply.get("ok") is bool and int(id) in _waiting:
			_answer(int(id), reply)


func _give_up_late_ones() -> void:
	var now := Time.get_ticks_msec()
	for id: int in _waiting.keys():
		if id in _waiting and now > _waiting[id].give_up:
			_fail(id, "no reply within %d s" % PATIENCE, "a reply")
			# A connection that has died without a word is not used again.
			_connection.close()


func _fail(id: int, found: String, expected: String) -> void:
	var where := "the control socket, %s:%d" % [host, port]
	var fix := "See whether the service runs, and whether its control socket has this address."
	var error := {"where": where, "found": found, "expected": expected, "fix": fix}
	_answer(id, {"id": id, "ok": false, "error": error})


func _answer(id: int, reply: Dictionary) -> void:
	var done: Callable = _waiting[id].done
	_waiting.erase(id)
	if done.is_valid():
		done.call(reply)
