extends "teller.gd"
## Runs two followers of the same topic, the first of which removes the other one: HOST PORT. They follow the topic
## again, after its first message, when the topic "late" arrives.

const Stream := preload("res://addons/puppetline/wire/stream.gd")
const Message := preload("res://addons/puppetline/wire/message.gd")

const TOPIC := "dog/performer"

var _stream: Stream


func start() -> void:
	_stream = Stream.shared(arguments()[0], int(arguments()[1]))
	_stream.follow(TOPIC, _one)
	_stream.follow(TOPIC, _other)
	_stream.follow("late", _come_late)


func step(_delta: float) -> bool:
	_stream.poll()
	if is_over():
		for receiver: Callable in [_one, _other, _keep]:
			_stream.unfollow(TOPIC, receiver)
		tell({"remembered": _stream._requested_ms.keys()})
	return is_over()


func _come_late(_message: Message) -> void:
	_stream.follow(TOPIC, _keep)
	_stream.unfollow(TOPIC, _one)
	_stream.unfollow(TOPIC, _other)
	_stream.follow(TOPIC, _one)
	_stream.follow(TOPIC, _other)


func _one(message: Message) -> void:
	tell({"who": "one", "sequence": message.sequence})
	_stream.unfollow(TOPIC, _other)


func _other(message: Message) -> void:
	tell({"who": "other", "sequence": message.sequence})
	_stream.unfollow(TOPIC, _one)


func _keep(_message: Message) -> void:
	pass
