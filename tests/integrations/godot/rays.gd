extends "teller.gd"
## Casts rays onto a character of a running service in one pose: {"puppet": properties, "rays": [[x, y, z, x, y, z]...],
## "scale": of the character, "file": path of the positions of all vertices; in MORPHS, the rest positions come first}.

var _puppet := Puppet3D.new()
var _asked: Dictionary
var _file: FileAccess


func start() -> void:
	_asked = JSON.parse_string(arguments()[0])
	for property: String in _asked["puppet"]:
		var value: Variant = _asked["puppet"][property]
		_puppet.set(property, load(value) if property == "mesh_source" else value)
	_file = FileAccess.open(_asked["file"], FileAccess.WRITE)
	_puppet.scene_loaded.connect(
		func() -> void: _file.store_buffer(_puppet.evaluate().to_byte_array()), CONNECT_ONE_SHOT
	)
	_puppet.scale = Vector3.ONE * float(_asked["scale"])
	root.add_child(_puppet)


func step(_delta: float) -> bool:
	var shown := _puppet.statistics()
	if not shown["calibrated"] or shown["sequence"] < 40 or shown["share"] == 0.0:
		return false
	_file.store_buffer(_puppet.evaluate().to_byte_array())
	_file.close()
	for ray: Array in _asked["rays"]:
		var hit := _puppet.intersect_ray(Vector3(ray[0], ray[1], ray[2]), Vector3(ray[3], ray[4], ray[5]))
		if hit.is_empty():
			tell({"hit": null})
		else:
			tell({"hit": _numbers(hit["position"]), "normal": _numbers(hit["normal"]), "vertex": hit["vertex"]})
	_puppet.free()
	return true


func _numbers(vector: Vector3) -> Array:
	return [vector.x, vector.y, vector.z]
