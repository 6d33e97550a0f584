extends "teller.gd"
## Plays a clip and reports the positions of all vertices: the path of a .clip or of an imported resource, and then the
## positions in the clip. "alone:N" lets it play by itself, and reports its position after each of N frames.

var _puppet := Puppet3D.new()
var _asked: PackedStringArray
var _is_set := false
var _alone := 0


func start() -> void:
	_asked = arguments()
	var path := _asked[0]
	var clip: PuppetClip
	if path.begins_with("res://"):
		clip = load(path)
	else:
		clip = PuppetClip.new()
		clip.data = FileAccess.get_file_as_bytes(path)
	tell({"problem": clip.problem(), "length": clip.length(), "character": clip.character()})
	_puppet.clip = clip
	_puppet.clip_speed = 0.0
	root.add_child(_puppet)
	_asked.remove_at(0)


func step(delta: float) -> bool:
	if _alone > 0:
		_alone -= 1
		tell({"position": _puppet.clip_position, "delta": delta})
		return _alone == 0 and _asked.is_empty()
	if _is_set:
		_is_set = false
		var positions := _puppet.evaluate()
		tell({"at": _puppet.clip_position, "positions": base64(positions.to_byte_array())})
		_asked.remove_at(0)
	if _asked.is_empty():
		_puppet.free()
		return true
	if _asked[0].begins_with("alone:"):
		_alone = int(_asked[0].trim_prefix("alone:"))
		_puppet.clip_speed = 1.0
		_asked.remove_at(0)
		return false
	_is_set = true
	_puppet.clip_position = float(_asked[0])
	return false
