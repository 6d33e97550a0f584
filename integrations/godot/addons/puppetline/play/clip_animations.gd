extends RefCounted
## Animations that play the mixed clips of a [Puppet3D], for AnimationPlayer and AnimationTree.

## Property of a mixed clip, by number: `mix/0` for the first one.
const PROPERTY_PREFIX := "mix/"


## Return a library with an animation per clip, and RESET, for an AnimationPlayer whose root node is the character.
static func library(clips: Array[PuppetClip]) -> AnimationLibrary:
	var made := AnimationLibrary.new()
	var reset := Animation.new()
	reset.length = 0.001
	for number in clips.size():
		if clips[number] == null:
			continue
		var animation := Animation.new()
		animation.length = maxf(clips[number].length(), reset.length)
		animation.loop_mode = Animation.LOOP_LINEAR
		_add_track(animation, number, [[0.0, Vector2(0.0, 1.0)], [animation.length, Vector2(animation.length, 1.0)]])
		made.add_animation(_name(clips[number], number, made), animation)
		_add_track(reset, number, [[0.0, Vector2.ZERO]])
	made.add_animation(&"RESET", reset)
	return made


static func _add_track(animation: Animation, number: int, keys: Array) -> void:
	var track := animation.add_track(Animation.TYPE_VALUE)
	animation.track_set_path(track, ".:%s%d" % [PROPERTY_PREFIX, number])
	animation.track_set_interpolation_loop_wrap(track, false)
	for key: Array in keys:
		animation.track_insert_key(track, key[0], key[1])


## Return the name of the clip's file, or a number if it has none or the name is used already.
static func _name(clip: PuppetClip, number: int, used: AnimationLibrary) -> StringName:
	var stem := clip.resource_path.get_file().get_basename().validate_node_name()
	return "clip_%d" % number if stem.is_empty() or used.has_animation(stem) or stem == "RESET" else stem
