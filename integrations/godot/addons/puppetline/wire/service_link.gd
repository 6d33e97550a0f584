extends RefCounted
## The connection of a node to a service: its stream, its control socket, and the search for it on the network if the
## host is empty.

## Emitted when [member state] has changed.
signal state_changed(before: Stream.State)
## Emitted when the names of the service's characters have arrived.
signal characters_changed
## Emitted with each status of the service.
signal status_received(status: Dictionary)

const Stream := preload("stream.gd")
const ControlSocket := preload("control.gd")
const Discovery := preload("discovery.gd")
const Message := preload("message.gd")

const _CHARACTERS := "service/characters"

## The stream; null until the address of the service is known.
var stream: Stream
## State of the stream, as last reported by [method notice_state].
var state := Stream.State.OFFLINE
## Names of the service's characters.
var characters: Array[String] = []

var _owner := ""  # name for errors
var _host := ""
var _port := 0
var _token := ""
var _character := ""
var _discovery: Discovery
var _control: ControlSocket
var _control_port := 0


## [param owner] is the name of the node for error messages. A service that is found on the network must have the [param
## character], unless that is empty.
func _init(owner: String, host: String, port: int, token: String, character: String) -> void:
	_owner = owner
	_host = host
	_port = port
	_token = token
	_character = character
	_control_port = port + 1


## Connect as soon as the address of the service is known; return false before.
func join() -> bool:
	if stream != null:
		return true
	var address := {"host": _host, "port": _port, "control": _port + 1}
	if _host.is_empty():
		address = _discovered()
		if address.is_empty():
			return false
	_discovery = null
	_control_port = address["control"]
	stream = Stream.shared(address["host"], address["port"], _token)
	stream.follow(_CHARACTERS, _on_characters)
	stream.follow(Stream.STATUS, _on_status)
	return true


## Disconnect. Requests without a reply get an error.
func close() -> void:
	_close_control()
	if stream == null:
		return
	stream.unfollow(_CHARACTERS, _on_characters)
	stream.unfollow(Stream.STATUS, _on_status)
	_change_state(Stream.State.OFFLINE)
	stream = null


## Return whether the service must be searched for again: one that was found on the network may have another address
## when it returns.
func is_lost() -> bool:
	return _host.is_empty() and stream != null and state == Stream.State.OFFLINE


## Take notice of the state of the stream.
func notice_state() -> void:
	if stream != null:
		_change_state(stream.state)


## Read the replies to requests.
func poll_control() -> void:
	if _control != null:
		_control.poll()


## Send a request (docs/control.md). [param done] is called with its reply, or with an error of the same form if there
## is no reply; without it, an error is a warning.
func request(body: Dictionary, done: Callable) -> void:
	if not done.is_valid():
		done = _warn_of_failure
	var address := _host if stream == null else stream.host
	if address.is_empty():
		var fix := "Start a service, or set host."
		var error := {"where": _owner, "found": "no service", "expected": "a service on the network", "fix": fix}
		done.call({"ok": false, "error": error})
		return
	if _control == null:
		_control = ControlSocket.new(address, _control_port, _token)
	_control.request(body, done)


## Send a request with the name of a character's stage, which is first requested from the service.
func request_of_stage(body: Dictionary, character: String, done: Callable) -> void:
	var find := func(reply: Dictionary) -> void:
		var result: Variant = reply.get("result")
		var list: Variant = result.get("characters") if result is Dictionary else null
		for each: Variant in list if list is Array else []:
			if each is Dictionary and each.get("name") is String and each["name"] == character:
				body["stage"] = each.get("stage")
		request(body, done)
	request({"do": "describe"}, find)


## Return the first service on the network that has the character; empty if there is none.
func _discovered() -> Dictionary:
	if _discovery == null:
		_discovery = Discovery.new()
		_discovery.search()
	_discovery.poll()
	var refused := ["CURVE"] if _token else ["PLAIN", "CURVE"]
	for service in _discovery.services:
		if service["mechanism"] not in refused and (_character.is_empty() or _character in service["characters"]):
			return service
	return {}


func _close_control() -> void:
	var left := _control
	_control = null
	if left != null:
		# Deferred, because other nodes may be leaving the scene together with this one.
		var answer := func() -> void: left.fail_all("a node that has disconnected from the service")
		answer.call_deferred()


func _change_state(to: Stream.State) -> void:
	if state != to:
		var before := state
		state = to
		state_changed.emit(before)


func _on_characters(message: Message) -> void:
	var list: Variant = message.json()
	if not list is Array:
		return
	characters.clear()
	for entry: Variant in list:
		if entry is Dictionary and entry.get("name") is String:
			characters.append(entry["name"])
	characters_changed.emit()


func _on_status(message: Message) -> void:
	var status: Variant = message.json()
	if status is Dictionary:
		status_received.emit(status)


static func _warn_of_failure(reply: Dictionary) -> void:
	if not reply.get("ok", false):
		var error: Variant = reply.get("error", {})
		push_warning("Puppetline: %s" % (" ".join(error.values().map(str)) if error is Dictionary else str(error)))
