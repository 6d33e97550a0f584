extends Node3D
## A place on the stage: a character with its lights and its name. The lights are bright while there is a performer.

## Emitted when a performer for this character has arrived or left.
signal taken_changed(taken: bool)

const LIT_SPOT_ENERGY := 5.6
const DIM_SPOT_ENERGY := 2.0
const RIM_ENERGY := 5.0
const RING_ENERGY := 0.9
const FADE_SECONDS := 1.2
## Time after which a connection that the service has refused is tried again, in seconds: its token may have changed.
const RETRY_SECONDS := 30.0

## Colour of the ring and of the light from behind.
@export var color := Color(1.0, 0.71, 0.42)

## Whether there is a performer, calibrated or not.
var taken := false

var _fading: Tween

@onready var puppet: Puppet3D = $Puppet
@onready var _spot: SpotLight3D = $Spot
@onready var _rim: SpotLight3D = $Rim
@onready var _name: Label3D = $Name
@onready var _hint: Label3D = $Hint
@onready var _glow: StandardMaterial3D = ($Ring as MeshInstance3D).mesh.surface_get_material(0)


func _ready() -> void:
	_name.text = puppet.character.capitalize().to_upper()
	_rim.light_color = color
	_glow.emission = color
	puppet.performer_found.connect(_on_performer_found)
	puppet.performer_calibrated.connect(_on_performer_calibrated)
	puppet.performer_lost.connect(_on_performer_lost)
	puppet.disconnected.connect(_on_disconnected)
	puppet.refused.connect(_on_refused)
	_show_taken(0.0)


func _on_performer_found(_user: int) -> void:
	_hint.text = "stand still for one second"
	_take(true)


func _on_performer_calibrated(_user: int) -> void:
	_hint.text = "you are the " + puppet.character.capitalize().to_lower()
	_take(true)


func _on_performer_lost(_user: int) -> void:
	_take(false)


func _on_disconnected() -> void:
	_take(false)


func _on_refused(_reason: String) -> void:
	get_tree().create_timer(RETRY_SECONDS).timeout.connect(puppet.retry)


func _take(on: bool) -> void:
	if not on:
		_hint.text = ""
	if on == taken:
		return
	taken = on
	_show_taken(FADE_SECONDS)
	taken_changed.emit(taken)


func _show_taken(seconds: float) -> void:
	var share := 1.0 if taken else 0.0
	if _fading != null:
		_fading.kill()
	_fading = create_tween().set_parallel().set_trans(Tween.TRANS_SINE).set_ease(Tween.EASE_IN_OUT)
	_fading.tween_property(_spot, ^"light_energy", lerpf(DIM_SPOT_ENERGY, LIT_SPOT_ENERGY, share), seconds)
	_fading.tween_property(_rim, ^"light_energy", lerpf(0.3, 1.0, share) * RIM_ENERGY, seconds)
	_fading.tween_property(_glow, ^"emission_energy_multiplier", lerpf(0.15, 1.0, share) * RING_ENERGY, seconds)
	_fading.tween_property(_name, ^"modulate:a", lerpf(0.55, 1.0, share), seconds)
