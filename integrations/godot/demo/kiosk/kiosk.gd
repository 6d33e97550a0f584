extends Node3D
## Two characters on a stage, for a public place. Without a performer, attract mode invites visitors to perform.
##
## The nodes `Left/Puppet` and `Right/Puppet` define the characters and their service.

## Emitted when attract mode begins or ends.
signal attracting_changed(attracting: bool)

## Amplitude of the camera's swaying, in radians.
const SWAY_RADIANS := 0.4

const Place := preload("res://demo/kiosk/place.gd")

## Time without a performer after which attract mode begins.
@export_range(0.0, 60.0, 0.5, "suffix:s") var patience := 2.0
## Period of the camera's swaying in attract mode.
@export_range(5.0, 120.0, 1.0, "suffix:s") var sway_seconds := 26.0

## Whether attract mode is on.
var attracting := true

var _seconds_alone := 0.0
var _time := 0.0

@onready var _places: Array[Place] = [$Left, $Right]
@onready var _orbit: Node3D = $Orbit
@onready var _prompt: Label = $Screen/Prompt
@onready var _connection: Label = $Screen/Connection


func _ready() -> void:
	for place: Place in _places:
		place.taken_changed.connect(_on_taken_changed)
		place.puppet.connected.connect(_connection.hide)
		place.puppet.disconnected.connect(_tell_missing.bind(place.puppet))
		place.puppet.refused.connect(_on_refused)
		_tell_missing(place.puppet)


func _process(delta: float) -> void:
	_time += delta
	_seconds_alone = 0.0 if _has_performer() else _seconds_alone + delta
	if not attracting and _seconds_alone >= patience:
		_attract(true)
	var sway := 0.0
	if attracting:
		sway = SWAY_RADIANS * sin(TAU * _time / sway_seconds)
		_prompt.modulate.a = 0.65 + 0.35 * sin(TAU * _time / 3.5)
	var share := 1.0 - exp(-1.4 * delta)
	_orbit.rotation.y = lerp_angle(_orbit.rotation.y, sway, share)
	_orbit.scale = _orbit.scale.lerp(Vector3.ONE * (1.12 if attracting else 1.0), share)


func _unhandled_input(event: InputEvent) -> void:
	if event.is_action_pressed(&"demo_menu"):
		get_tree().change_scene_to_file("res://demo/menu.tscn")
	elif event.is_action_pressed(&"demo_calibrate"):
		for place: Place in _places:
			place.puppet.calibrate()


func _has_performer() -> bool:
	return _places.any(func(place: Place) -> bool: return place.taken)


func _on_taken_changed(taken: bool) -> void:
	if taken:
		_attract(false)


func _attract(on: bool) -> void:
	if on == attracting:
		return
	attracting = on
	_time = 0.0
	_prompt.visible = on
	attracting_changed.emit(on)


func _on_refused(reason: String) -> void:
	_connection.text = reason
	_connection.show()


func _tell_missing(puppet: Puppet3D) -> void:
	_connection.text = "No data from %s:%d. Start a service with: puppetline demo --live" % [puppet.host, puppet.port]
	_connection.show()
