extends "teller.gd"
## Makes three requests of which the first to be answered ends them all, and tells what is answered: PORT HOW. "close"
## and "give_up" are what the receiver does when nobody answers at the port, "late" closes when the replies are overdue,
## "drop" has nobody's answer waited for.

const ControlSocket := preload("res://addons/puppetline/wire/control.gd")

var _control: ControlSocket
var _how := arguments()[1]
var _answers := 0
var _frames := 0


func _initialize() -> void:
	super()
	_control = ControlSocket.new("127.0.0.1", int(arguments()[0]))
	for number in 3:
		_control.request({"do": "ping"}, _take.bind(number))
	if _how == "late":
		for each: Variant in _control._pending.values():
			each.deadline_ms = 0
	if _how == "drop":
		_control.fail_all("It is over.")


func _process(_delta: float) -> bool:
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
