extends Node3D
## A film set with two characters, three camera moves, and takes that are recorded, played, trimmed and filmed.
##
## The service records the motion of performers and plays takes on its characters. Arguments after `--` name takes, as
## in `pegasus=first human=second`, and optionally `from=SECONDS` and `to=SECONDS`. The scene then plays them once and
## quits, so that Godot's movie writer makes a film of them.

const CameraMoves := preload("res://demo/film/camera_moves.gd")
const Timeline := preload("res://demo/film/timeline.gd")
const Transport := preload("res://demo/film/transport.gd")

## Time in which characters ease into a take before it is filmed, in seconds.
const EASE_SECONDS := 1.0

@onready var _puppets: Array[Puppet3D] = [$Live, $Partner]
@onready var _camera: CameraMoves = $Camera
@onready var _timeline: Timeline = $Timeline
@onready var _transport: Transport = $Screen/Transport
@onready var _state: Label = $Screen/State


func _ready() -> void:
	var live := _puppets[0]
	_timeline.follow(live)
	_transport.follow(live, _timeline)
	live.connected.connect(_say.bind("live"))
	live.disconnected.connect(_say.bind("no service; start one with: puppetline demo --live"))
	live.refused.connect(_say)
	live.performer_found.connect(func(_user: int) -> void: _say("stand still for one second"))
	live.performer_calibrated.connect(func(_user: int) -> void: _say("live"))
	live.performer_lost.connect(func(_user: int) -> void: _say("no performer"))
	_timeline.changed.connect(_show_timeline)
	_say("connecting to %s:%d" % [live.host, live.port])
	var takes: Dictionary = {}
	for argument in OS.get_cmdline_user_args():
		if "=" in argument:
			takes[argument.get_slice("=", 0)] = argument.get_slice("=", 1)
	if not takes.is_empty():
		_film(takes)


func _unhandled_input(event: InputEvent) -> void:
	if event.is_action_pressed(&"demo_menu"):
		get_tree().change_scene_to_file("res://demo/menu.tscn")
	elif event.is_action_pressed(&"demo_record"):
		_transport.toggle_recording()
	elif event.is_action_pressed(&"demo_hide"):
		_transport.visible = not _transport.visible
	elif event.is_action_pressed(&"demo_calibrate"):
		_puppets[0].calibrate()
	for shot: int in _camera.shots():
		if event.is_action_pressed("demo_shot_%d" % (shot + 1)):
			_camera.cut_to(shot)


## Play takes by the names of their characters, and quit. No image is written while they are prepared.
func _film(takes: Dictionary) -> void:
	$Screen.hide()
	_timeline.first = float(takes.get("from", "0"))
	_timeline.last = float(takes["to"]) if "to" in takes else INF
	takes.erase("from")
	takes.erase("to")
	var characters := takes.keys()
	_puppets = _puppets.slice(0, characters.size())
	$Partner.visible = characters.size() > 1
	var loaded: Dictionary = {}
	for number in _puppets.size():
		_puppets[number].character = characters[number]
		_puppets[number].scene_loaded.connect(func() -> void: loaded[number] = true)
	_wait_for(func() -> bool: return loaded.size() == _puppets.size())
	for character: String in characters:
		_wait_for_reply(func(done: Callable) -> void: _timeline.play(character, takes[character], done))
		_wait_for_reply(func(done: Callable) -> void: _timeline.pause(true, done))
	_wait_for_reply(func(done: Callable) -> void: _timeline.seek(_timeline.first, done))
	var begin := Time.get_ticks_msec() + 1000 * EASE_SECONDS
	_wait_for(func() -> bool: return Time.get_ticks_msec() > begin)
	_wait_for_reply(func(done: Callable) -> void: _timeline.pause(false, done))
	_timeline.is_filmed = true
	_timeline.last = minf(_timeline.last, _timeline.state["end"])
	_timeline.ended.connect(func() -> void: get_tree().quit())
	for puppet in _puppets:
		puppet.clock = Puppet3D.Clock.ENGINE
	_camera.cut_to(0)


func _wait_for(is_done: Callable) -> void:
	while not is_done.call():
		for puppet in _puppets:
			puppet.refresh()
		OS.delay_msec(2)


## Wait for the reply to a request, which gets the function to call with it. An error ends the program.
func _wait_for_reply(request: Callable) -> void:
	var replies: Array[Dictionary] = []
	request.call(replies.append)
	_wait_for(func() -> bool: return not replies.is_empty())
	if not replies[0].get("ok", false):
		printerr("Puppetline: %s" % Transport.text_of_error(replies[0]))
		OS.kill(OS.get_process_id())


func _show_timeline() -> void:
	if _timeline.state.is_empty():
		_say("live")
	else:
		_say("take, paused" if _timeline.state["paused"] else "take")


func _say(what: String) -> void:
	_state.text = what.to_upper()
