extends "teller.gd"
## Follows topics, stops polling until the test continues, and reports the messages received then: HOST PORT TOPIC...

const Stream := preload("res://addons/puppetline/wire/stream.gd")
const Message := preload("res://addons/puppetline/wire/message.gd")

var _stream: Stream
var _looks_away := false


func start() -> void:
	_stream = Stream.shared(arguments()[0], int(arguments()[1]))
	for topic in arguments().slice(2):
		_stream.follow(topic, _take)


func step(_delta: float) -> bool:
	if _looks_away:
		tell({"looks_away": true})
		while not is_over():
			OS.delay_msec(5)
		_stream.poll()
		return true
	_stream.poll()
	_looks_away = _stream.state == Stream.State.CONNECTED
	return false


func _take(message: Message) -> void:
	tell({"topic": message.topic, "sequence": message.sequence})
