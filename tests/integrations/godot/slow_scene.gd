extends "teller.gd"
## Requests the scene of a character, and reports states, the first bytes of a message and each scene: HOST PORT
## CHARACTER.

const Stream := preload("res://addons/puppetline/wire/stream.gd")
const SharedScene := preload("res://addons/puppetline/play/shared_scene.gd")

var _stream: Stream
var _shared: SharedScene
var _is_receiving := false


func start() -> void:
	_stream = Stream.shared(arguments()[0], int(arguments()[1]))
	_stream.state_changed.connect(_tell_state)
	_shared = SharedScene.shared(_stream, arguments()[2])
	_shared.changed.connect(_tell_scene)


func step(_delta: float) -> bool:
	_stream.poll()
	_shared.poll()
	if _stream.is_receiving() and not _is_receiving:
		_is_receiving = true
		tell({"receiving": true})
	if is_over():
		_stream.state_changed.disconnect(_tell_state)
		_shared.changed.disconnect(_tell_scene)
		_shared = null
	return is_over()


func _tell_state(state: Stream.State) -> void:
	tell({"state": Stream.State.keys()[state], "reason": _stream.reason})


func _tell_scene() -> void:
	tell({"topic": "scene", "vertices": _shared.scene.vertex_count})
