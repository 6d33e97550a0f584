extends "teller.gd"
## Requests the scene of a character, and reports each received scene and status: HOST PORT CHARACTER.

const Stream := preload("res://addons/puppetline/wire/stream.gd")
const Message := preload("res://addons/puppetline/wire/message.gd")
const SharedScene := preload("res://addons/puppetline/play/shared_scene.gd")

var _stream: Stream
var _shared: SharedScene


func start() -> void:
	_stream = Stream.shared(arguments()[0], int(arguments()[1]))
	_stream.state_changed.connect(_tell_state)
	_stream.follow(Stream.STATUS, _tell_message.bind("status"))
	_shared = SharedScene.shared(_stream, arguments()[2])
	_stream.follow(_shared._topic, _tell_message.bind("scene"))


func step(_delta: float) -> bool:
	_stream.poll()
	_shared.poll()
	if is_over():
		_stream.state_changed.disconnect(_tell_state)
		tell({"vertices": _shared.scene.vertex_count})
		_stream.unfollow(_shared._topic, _tell_message.bind("scene"))
		_shared = null
	return is_over()


func _tell_state(state: Stream.State) -> void:
	tell({"state": Stream.State.keys()[state], "reason": _stream.reason})


func _tell_message(message: Message, what: String) -> void:
	tell({"topic": what, "size": message.payload.size()})
