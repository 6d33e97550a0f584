extends "teller.gd"
## Sends all requests together and reports the replies: HOST PORT TOKEN REQUEST...

const ControlSocket := preload("res://addons/puppetline/wire/control.gd")

var _control: ControlSocket
var _missing := 0


func start() -> void:
	_control = ControlSocket.new(arguments()[0], int(arguments()[1]), arguments()[2])
	for body in arguments().slice(3):
		_missing += 1
		_control.request(JSON.parse_string(body), _take.bind(body))


func step(_delta: float) -> bool:
	_control.poll()
	return _missing == 0


func _take(reply: Dictionary, body: String) -> void:
	_missing -= 1
	tell({"request": JSON.parse_string(body), "reply": reply})
