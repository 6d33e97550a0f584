extends "teller.gd"
## Connects to a service that refuses it, waits, and retries: HOST PORT TOKEN.

const Stream := preload("res://addons/puppetline/wire/stream.gd")

var _stream: Stream
var _refused_at := 0
var _changes := 0


func start() -> void:
	_stream = Stream.new(arguments()[0], int(arguments()[1]), arguments()[2])
	_stream.state_changed.connect(_note)


func step(_delta: float) -> bool:
	_stream.poll()
	if _stream.state != Stream.State.REFUSED or Time.get_ticks_msec() < _refused_at + 3000:
		return false
	tell({"changes": _changes, "reason": _stream.reason})
	if _changes > 2:
		return true
	_stream.retry()
	return false


func _note(state: Stream.State) -> void:
	_changes += 1
	if state == Stream.State.REFUSED:
		_refused_at = Time.get_ticks_msec()
