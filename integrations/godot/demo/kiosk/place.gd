extends Node3D
## A place on the stage: a character, its light and its name. It lights up while somebody performs.

## Emitted when somebody has come to perform this character, or has gone.
signal taken_changed(taken: bool)

const LIT := 5.6
const DIM := 2.0
const RIM := 5.0
const RING := 0.9
const FADE := 1.2

## What the ring and the light from behind have.
@export var color := Color(1.0, 0.71, 0.42)

## Whether somebody performs, or is about to.
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
	_show_taken(0.0)


func _on_performer_found(_user: int) -> void:
	_hint.text = "stand still for a moment"
	_take(true)


func _on_performer_calibrated(_user: int) -> void:
	_hint.text = "you are the " + puppet.character.capitalize().to_lower()
	_take(true)


func _on_performer_lost(_user: int) -> void:
	_take(false)


func _on_disconnected() -> void:
	_take(false)


func _take(on: bool) -> void:
	if not on:
		_hint.text = ""
	if on == taken:
		return
	taken = on
	_show_taken(FADE)
	taken_changed.emit(taken)


func _show_taken(seconds: float) -> void:
	var share := 1.0 if taken else 0.0
	if _fading != null:
		_fading.kill()
	_fading = create_tween().set_parallel().set_trans(Tween.TRANS_SINE).set_ease(Tween.EASE_IN_OUT)
	_fading.tween_property(_spot, ^"light_energy", lerpf(DIM, LIT, share), seconds)
	_fading.tween_property(_rim, ^"light_energy", lerpf(0.3, 1.0, share) * RIM, seconds)
	_fading.tween_property(_glow, ^"emission_energy_multiplier", lerpf(0.15, 1.0, share) * RING, seconds)
	_fading.tween_property(_name, ^"modulate:a", lerpf(0.55, 1.0, share), seconds)
