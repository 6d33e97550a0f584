extends "teller.gd"
## Sets clips that nobody has read in a running game, and reports what is shown after the first frame with each, and
## when it has been loaded: "clip:PATH", "manual:PATH" for the same with the clock MANUAL, or "mixed:PATH" for a mixed
## clip with all the weight. The last one is freed while it is loaded.

var _puppet := Puppet3D.new()
var _asked: PackedStringArray
var _is_set := false


func start() -> void:
	_asked = arguments()
	_puppet.port = 1
	_puppet.clip_speed = 0.0


func step(_delta: float) -> bool:
	if not _is_set:
		_is_set = true
		_set_clip(_asked[0].get_slice(":", 0), _asked[0].get_slice(":", 1))
		_puppet._process(0.0)
		_tell("first")
		if _asked.size() == 1:
			_puppet.free()
			return true
	elif not _puppet._clips_stale:
		_puppet._process(0.0)
		_tell("loaded")
		_is_set = false
		_asked.remove_at(0)
	return false


func _set_clip(how: String, path: String) -> void:
	var clip := PuppetClip.new()
	clip.data = FileAccess.get_file_as_bytes(path)
	_puppet.clock = Puppet3D.Clock.MANUAL if how == "manual" else Puppet3D.Clock.REALTIME
	if how == "mixed":
		_puppet.mixed_clips = [clip] as Array[PuppetClip]
		_puppet.set("mix/0", Vector2(0.0, 1.0))
	else:
		_puppet.clip = clip
	if not _puppet.is_inside_tree():
		root.add_child(_puppet)


func _tell(when: String) -> void:
	var positions := base64(_puppet.evaluate().to_byte_array())
	tell({"when": when, "positions": positions, "looks_for_service": _puppet._followed.link != null})
