extends "teller.gd"
## Sends three requests, ends all of them in the first callback, and reports the replies: PORT HOW. With "close" and
## "give_up", the callback closes or fails all requests after a failed connection. With "late", it closes them after the
## timeout. "drop" fails all requests without waiting.

const ControlSocket := preload("res://addons/puppetline/wire/control.gd")

var _control: ControlSocket
var _how := arguments()[1]
var _answers := 0
var _frames := 0


func start() -> void:
	_control = ControlSocket.new("127.0.0.1", int(arguments()[0]))
	for number in 3:
		_control.request({"do": "ping"}, _take.bind(number))
	if _how == "late":
		for each: Variant in _control._pending.values():
			each.deadline_ms = 0
	if _how == "drop":
		_control.fail_all("It is over.")


func step(_delta: float) -> bool:
	_control.poll()
	_frames += int(_answers > 0)
	if _frames == 10:
		tell({"waiting": _control._pending.size()})
	return _frames == 10


func _take(reply: Dictionary, number: int) -> void:
	_answers += 1
	tell({"number": number, "ok": reply["ok"], "found": reply["error"]["found"]})
	if _how == "give_up":
		_control.fail_all("It is over.")
	elif _how != "drop":
		_control.close()
