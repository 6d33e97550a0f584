extends "teller.gd"
## Sends all requests together and reports the replies: HOST PORT TOKEN REQUEST... With `--again` before the requests,
## it sends them five times per second until the test ends it.

const ControlSocket := preload("res://addons/puppetline/wire/control.gd")

var _control: ControlSocket
var _again := arguments()[3] == "--again"
var _bodies := arguments().slice(4 if _again else 3)
var _missing := 0
var _next := 0


func start() -> void:
	_control = ControlSocket.new(arguments()[0], int(arguments()[1]), arguments()[2])
	if not _again:
		_request()


func step(_delta: float) -> bool:
	if _again and Time.get_ticks_msec() > _next:
		_next = Time.get_ticks_msec() + 200
		_request()
	_control.poll()
	return is_over() if _again else _missing == 0


func _request() -> void:
	for body in _bodies:
		_missing += 1
		_control.request(JSON.parse_string(body), _take.bind(body))


func _take(reply: Dictionary, body: String) -> void:
	_missing -= 1
	tell({"request": JSON.parse_string(body), "reply": reply})
