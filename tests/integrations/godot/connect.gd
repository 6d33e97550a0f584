extends "teller.gd"
## Connects once and reports states and messages: HOST PORT SOCKET_TYPE TOKEN MAX_MESSAGE_BYTES TOPIC...

const Connection := preload("res://addons/puppetline/wire/connection.gd")
const Connections := preload("res://addons/puppetline/wire/connections.gd")

var _connection: Connection
var _state := -1
var _most_memory := 0


func start() -> void:
	_connection = Connections.make(arguments()[0], arguments()[2], arguments()[3])
	_connection.max_message_bytes = int(arguments()[4])
	_connection.open(arguments()[0], int(arguments()[1]))


func step(_delta: float) -> bool:
	_connection.poll()
	_most_memory = maxi(_most_memory, OS.get_static_memory_usage())
	if _connection.state != _state:
		_state = _connection.state
		tell({"state": Connection.State.keys()[_state], "reason": _connection.reason})
		if _state == Connection.State.READY:
			for topic in arguments().slice(5):
				_connection.subscribe(topic)
	for message in _connection.take():
		tell({"size": message.size(), "sha256": sha256(message)})
	if is_over():
		_connection.close()
		tell({"memory": _most_memory})
	return is_over()
