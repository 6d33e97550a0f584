extends "rendered_node.gd"
## Base of [Puppet3D]: the clips that the node plays, and that animations mix.

const ClipPlayer := preload("clip_player.gd")
const ClipAnimations := preload("clip_animations.gd")
const Playback := preload("playback.gd")
const MixedPlayback := preload("mixed_playback.gd")

@export_group("Clip")
## A clip that the node plays instead of a service's stream.
@export var clip: PuppetClip:
	set(value):
		_clips_stale = _clips_stale or value != clip
		clip = value
## Shown position of the [member clip], in seconds. An AnimationPlayer can animate it, with a [member clip_speed] of 0.
@export_range(0.0, 600.0, 0.001, "or_greater", "suffix:s") var clip_position := 0.0
## Speed at which the [member clip] plays automatically. Pauses of the game and `Engine.time_scale` apply; with the
## clock MANUAL, [method advance] moves it.
@export var clip_speed := 1.0
## Whether the [member clip] begins again after its end.
@export var clip_loops := true
## Clips of one character that an AnimationPlayer or an AnimationTree mixes, by the animations of [method
## make_clip_animations]. If their weights add up to less than 1, [member clip] has the rest.
@export var mixed_clips: Array[PuppetClip] = []:
	set(value):
		_clips_stale = true
		mixed_clips = value
		_clips.resize(value.size())
## Weight of the performer against the clips: 0 shows the clips, 1 the performer. The node connects to the service when
## the weight is first greater than 0, and shows the clips until a frame arrives.
@export_range(0.0, 1.0, 0.001) var live_weight := 0.0

var _clips := ClipPlayer.new()
var _clips_stale := false
var _shown := MixedPlayback.new()


## Return an animation per clip of [member mixed_clips], and RESET, for an AnimationPlayer whose root node is this node.
## An AnimationTree blends them. An AnimationPlayer does so if its `deterministic` is on.
func make_clip_animations() -> AnimationLibrary:
	return ClipAnimations.library(mixed_clips)


## The properties that animations of clips set: `mix/0` and so on.
func _set(property: StringName, value: Variant) -> bool:
	var number := _mix_number(property)
	if number >= 0 and value is Vector2:
		_clips.mix[number] = value
	return number >= 0


func _get(property: StringName) -> Variant:
	var number := _mix_number(property)
	return _clips.mix[number] if number >= 0 else null


## Return the number of the mixed clip to which a property belongs; −1 for other properties.
func _mix_number(property: StringName) -> int:
	if not property.begins_with(ClipAnimations.PROPERTY_PREFIX):
		return -1
	var number := property.trim_prefix(ClipAnimations.PROPERTY_PREFIX).to_int()
	return number if number < _clips.mix.size() else -1


## Return whether threads have loaded the clips that have been set, one after another. Images of the editor and of a
## movie do not wait for threads.
func _has_loaded_clips(with_mesh: bool) -> bool:
	if Engine.is_editor_hint() or OS.has_feature("movie"):
		return true
	for each: PuppetClip in [clip] + mixed_clips:
		if each != null and not each.load_in_thread(with_mesh):
			return false
	return true


## Use the clips that have been set; return whether their scene is another one than before.
func _take_clips() -> bool:
	_clips_stale = false
	var before := _clips.first()
	_clips.set_clips(clip, mixed_clips)
	var now := _clips.first()
	return before == null or now == null or before.shared_scene() != now.shared_scene()


func _move_clip(seconds: float) -> void:
	if clip == null or clip_speed == 0.0 or _clips_stale:
		return
	var moved := clip_position + clip_speed * seconds
	var length := clip.length()
	clip_position = fposmod(moved, length) if clip_loops and length > 0.0 else clampf(moved, 0.0, length)


## Mix the frames of a performer with the clips; null for no performer.
func _mix(live: Playback) -> void:
	var parts: Array[Playback] = []
	var weights := PackedFloat64Array()
	var share := (live_weight if _clips.is_used else 1.0) if live != null else 0.0
	if share > 0.0:
		parts.append(live)
		weights.append(share)
	if _clips.is_used and share < 1.0:
		_clips.advance(clip_position)
		for i in _clips.shown.size():
			parts.append(_clips.shown[i])
			weights.append((1.0 - share) * _clips.weights[i])
	_shown.mix(parts, weights)
