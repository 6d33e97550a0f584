extends SceneTree
## Runs test scripts one after another, as a test asks for them through a socket: PORT.
##
## A request has a length of 4 bytes, and then JSON: {"script": path, "arguments": [text...]} starts a script, anything
## else while it runs ends it. With {"clock": file}, the time of connections is the number of seconds in that file. The
## line DONE follows what a script prints. The end of the socket ends the process.

const Connection := preload("res://addons/puppetline/wire/connection.gd")

const DONE := "DONE"

var arguments: PackedStringArray = []

var _connection := StreamPeerTCP.new()
var _scripts: Dictionary = {}  # path: GDScript, so that a script is loaded once
var _request: Dictionary = {}
var _pause := 0
var _current: RefCounted = null
var _former: WeakRef = null
var _window := Vector2i.ZERO


func _initialize() -> void:
	Engine.max_fps = 120
	_window = DisplayServer.window_get_size()
	_connection.connect_to_host("127.0.0.1", int(OS.get_cmdline_user_args()[0]))
	while _connection.get_status() == StreamPeerTCP.STATUS_CONNECTING:
		OS.delay_msec(1)
		_connection.poll()


func _process(delta: float) -> bool:
	if _former != null:
		_report_end()
	if _current == null:
		return not _begin_next()
	if _current.step(delta) or _current.is_done:
		_end()
	return false


func is_over() -> bool:
	return _connection.get_available_bytes() > 0


## Begin the next script; return false after the last one.
##
## Waiting for a request takes no processor time, and so makes two frames long: this one, and the next one's delta.
func _begin_next() -> bool:
	if _request.is_empty():
		_request = _next_request()
		_pause = 1
		return not _request.is_empty()
	if _pause > 0:
		_pause -= 1
		return true
	arguments = _request["arguments"]
	var path: String = _request["script"]
	var clock: Variant = _request.get("clock")
	if clock is String:
		Connection.clock = func() -> int: return int(1000 * FileAccess.get_file_as_string(clock).to_float())
	_request = {}
	if path not in _scripts:
		_scripts[path] = load(path)
	_current = _scripts[path].new()
	_current.start()
	return true


## Return the next request, or nothing at the end of the socket.
func _next_request() -> Dictionary:
	while true:
		var size: Array = _connection.get_data(4)
		if size[0] != OK:
			break
		var body: Array = _connection.get_data((size[1] as PackedByteArray).decode_u32(0))
		if body[0] != OK:
			break
		var request: Variant = JSON.parse_string((body[1] as PackedByteArray).get_string_from_utf8())
		if request is Dictionary:
			return request
	return {}


## Leave everything as the script has found it; other objects end with the frame.
func _end() -> void:
	_former = weakref(_current)
	_current = null
	Connection.clock = Callable()
	for node in root.get_children():
		node.free()
	root.disable_3d = false
	root.scaling_3d_scale = 1.0
	DisplayServer.window_set_size(_window)


func _report_end() -> void:
	if _former.get_ref() != null:
		push_error("the script is still in use after its end")
	if Performance.get_monitor(Performance.OBJECT_ORPHAN_NODE_COUNT) > 0:
		push_error("nodes of the script have leaked")
	_former = null
	print(DONE)
