extends "teller.gd"
## Deforms a character of a running service on the graphics card, and saves the results of some frames: {"settings":
## properties of Puppet3D, "samples": number of frames, "apart": frames between two samples, "box": [corner, size] of
## the numbers, "file": path of the images}.

const GpuReader := preload("gpu_reader.gd")

var _asked: Dictionary
var _puppet := Puppet3D.new()


func start() -> void:
	root.disable_3d = true
	DisplayServer.window_set_size(Vector2i(64, 64))
	_asked = JSON.parse_string(arguments()[0])
	for property: String in _asked["settings"]:
		var value: Variant = _asked["settings"][property]
		_puppet.set(property, load(value) if property == "mesh_source" else value)
	root.add_child(_puppet)
	await _read()
	_puppet.free()
	quit()


func _read() -> void:
	var file := FileAccess.open(_asked["file"], FileAccess.WRITE)
	var box := AABB(_vector(_asked["box"][0]), _vector(_asked["box"][1]))
	var next := 0
	for _sample: int in _asked["samples"]:
		while not _puppet.statistics()["calibrated"] or _puppet.statistics()["sequence"] < next:
			await process_frame
		next = _puppet.statistics()["sequence"] + int(_asked["apart"])
		_puppet.set_process(false)
		var reader := GpuReader.new(root, _puppet.get_child(-1, true), box)
		file.store_buffer(await reader.read())
		reader.free_pictures()
		var bounds := (_puppet.find_children("*", "MeshInstance3D", true, false)[0] as MeshInstance3D).custom_aabb
		tell(_puppet.statistics().merged({"bounds": [_numbers(bounds.position), _numbers(bounds.end)]}))
		_puppet.set_process(true)


func _vector(numbers: Array) -> Vector3:
	return Vector3(numbers[0], numbers[1], numbers[2])


func _numbers(vector: Vector3) -> Array:
	return [vector.x, vector.y, vector.z]
