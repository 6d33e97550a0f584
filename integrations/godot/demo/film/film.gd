extends Node3D
## A film set with one character, three camera moves, and takes that are recorded and replayed.
##
## The service records the motion of the performer, not the image. A second service on another port plays a take;
## [member command] starts it.

const CameraMoves := preload("res://demo/film/camera_moves.gd")
const Transport := preload("res://demo/film/transport.gd")

## Command that starts a service that plays a take. Its placeholders are the character's name, the take's name and a
## port.
@export_multiline var command := 'puppetline serve --puppet out/%s.toml --source "replay:takes/%s.log?loop" --port %d'

@onready var _live: Puppet3D = $Live
@onready var _played: Puppet3D = $Played
@onready var _camera: CameraMoves = $Camera
@onready var _transport: Transport = $Screen/Transport
@onready var _state: Label = $Screen/State


func _ready() -> void:
	_transport.follow(_live)
	_transport.play_asked.connect(_on_play_asked)
	_transport.live_asked.connect(_show_live)
	_played.character = _live.character
	_played.scene_loaded.connect(_show_played)
	_live.connected.connect(_say.bind("live"))
	_live.disconnected.connect(_say.bind("no service; start one with: puppetline demo --live"))
	_live.refused.connect(_say)
	_live.performer_found.connect(func(_user: int) -> void: _say("stand still for one second"))
	_live.performer_calibrated.connect(func(_user: int) -> void: _say("live"))
	_live.performer_lost.connect(func(_user: int) -> void: _say("no performer"))
	_say("connecting to %s:%d" % [_live.host, _live.port])
	_show_live()


func _unhandled_input(event: InputEvent) -> void:
	if event.is_action_pressed(&"demo_menu"):
		get_tree().change_scene_to_file("res://demo/menu.tscn")
	elif event.is_action_pressed(&"demo_record"):
		_transport.toggle_recording()
	elif event.is_action_pressed(&"demo_hide"):
		_transport.visible = not _transport.visible
	elif event.is_action_pressed(&"demo_calibrate"):
		_live.calibrate()
	for shot: int in _camera.shots():
		if event.is_action_pressed("demo_shot_%d" % (shot + 1)):
			_camera.cut_to(shot)


func _on_play_asked(take: String) -> void:
	_played.process_mode = Node.PROCESS_MODE_INHERIT
	_transport.show_command(command % [_live.character, take, _played.port])


func _show_played() -> void:
	_live.hide()
	_played.show()
	_say("take")


func _show_live() -> void:
	_played.process_mode = Node.PROCESS_MODE_DISABLED
	_played.hide()
	_live.show()


func _say(what: String) -> void:
	_state.text = what.to_upper()
