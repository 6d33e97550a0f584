extends "teller.gd"
## Follows topics and reports their messages: HOST PORT TOKEN TOPIC...

const Stream := preload("res://addons/puppetline/wire/stream.gd")
const Message := preload("res://addons/puppetline/wire/message.gd")

var _stream: Stream


func start() -> void:
	_stream = Stream.shared(arguments()[0], int(arguments()[1]), arguments()[2])
	_stream.state_changed.connect(_tell_state)
	for topic in arguments().slice(3):
		_stream.follow(topic, _take)


func step(_delta: float) -> bool:
	_stream.poll()
	if is_over():
		tell({"status": _stream.last_status, "latency": _stream.same_machine_latency()})
		_stream.state_changed.disconnect(_tell_state)
	return is_over()


func _tell_state(state: Stream.State) -> void:
	tell({"state": Stream.State.keys()[state], "reason": _stream.reason})


func _take(message: Message) -> void:
	var told := {"topic": message.topic, "sequence": message.sequence, "revision": message.revision}
	tell(told.merged({"size": message.payload.size(), "sha256": sha256(message.payload)}))
