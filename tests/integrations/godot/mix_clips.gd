extends "teller.gd"
## Mixes two clips and reports the positions of all vertices: the paths of two .clip files, "tree" or "player", and then
## WEIGHT:SECONDS with growing seconds. "tree" blends with an AnimationTree, by the weight of the second clip; "player"
## plays the first clip with an AnimationPlayer.

var _puppet := Puppet3D.new()
var _player := AnimationPlayer.new()
var _tree: AnimationTree  # null for the player
var _asked: PackedStringArray
var _now := 0.0


func start() -> void:
	_asked = arguments()
	var clips: Array[PuppetClip] = []
	for path in _asked.slice(0, 2):
		clips.append(PuppetClip.new())
		clips[-1].data = FileAccess.get_file_as_bytes(path)
	_puppet.mixed_clips = clips
	root.add_child(_puppet)
	_puppet.add_child(_player)
	_player.root_node = _player.get_path_to(_puppet)
	_player.add_animation_library("", _puppet.make_clip_animations())
	tell({"shared": clips[0].shared_scene() == clips[1].shared_scene(), "animations": _player.get_animation_list()})
	if _asked[2] == "tree":
		_plant()
	else:
		_player.play("clip_0", -1.0, 0.0)
	_asked = _asked.slice(3)
	_seek()


func step(_delta: float) -> bool:
	if _puppet.statistics()["sequence"] < 0:
		return false
	var positions := _puppet.evaluate()
	tell({"positions": base64(positions.to_byte_array()), "surface": str(_puppet.get_surface_transform(7).origin)})
	_asked.remove_at(0)
	if _asked.is_empty():
		_puppet.free()
		return true
	_seek()
	return false


func _seek() -> void:
	var asked := _asked[0].split_floats(":")
	if _tree != null:
		_tree.set("parameters/blend/blend_amount", asked[0])
		_tree.advance(asked[1] - _now)
		_now = asked[1]
	else:
		_player.seek(asked[1], true)


func _plant() -> void:
	_tree = AnimationTree.new()
	var mixed := AnimationNodeBlendTree.new()
	var blend := AnimationNodeBlend2.new()
	blend.sync = true  # a clip without weight moves on
	for number in 2:
		var played := AnimationNodeAnimation.new()
		played.animation = "clip_%d" % number
		mixed.add_node(str(number), played)
	mixed.add_node("blend", blend)
	mixed.connect_node("blend", 0, "0")
	mixed.connect_node("blend", 1, "1")
	mixed.connect_node("output", 0, "blend")
	_tree.tree_root = mixed
	_tree.callback_mode_process = AnimationMixer.ANIMATION_CALLBACK_MODE_PROCESS_MANUAL
	_puppet.add_child(_tree)
	_tree.anim_player = _tree.get_path_to(_player)
	_tree.advance(0.0)
