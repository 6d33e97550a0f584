extends "teller.gd"
## Runs two followers of the same service, one of which starts late: HOST PORT. They perform the next step each time the
## publisher sends the topic "step" with a number.

const Stream := preload("res://addons/puppetline/wire/stream.gd")
const Message := preload("res://addons/puppetline/wire/message.gd")

var _one: Stream
var _other: Stream


func start() -> void:
	_one = Stream.shared(arguments()[0], int(arguments()[1]))
	_one.follow("step", _do_step)
	_one.follow("dog/performer", _take_one)
	_one.follow("dog/controls", _take_one)


func step(_delta: float) -> bool:
	_one.poll()
	if _other:
		_other.poll()
	return is_over()


func _do_step(message: Message) -> void:
	match message.sequence:
		1:
			_other = Stream.shared(arguments()[0], int(arguments()[1]))
			_other.follow("dog/performer", _take_other)
			_other.follow("dog/controls", _take_other)
		2:
			_one.unfollow("dog/performer", _take_one)
			_one.unfollow("dog/controls", _take_one)
		3:
			_other.unfollow("dog/performer", _take_other)
			_other.unfollow("dog/controls", _take_other)
	tell({"step": message.sequence, "same": _one == _other})


func _take_one(message: Message) -> void:
	tell({"who": "one", "topic": message.topic, "sequence": message.sequence})


func _take_other(message: Message) -> void:
	tell({"who": "other", "topic": message.topic, "sequence": message.sequence})
