extends "teller.gd"
## Reports the contents of each message in a file, which contains a length of 4 bytes before each message.

const Message := preload("res://addons/puppetline/wire/message.gd")
const Scene := preload("res://addons/puppetline/wire/scene.gd")


func start() -> void:
	var file := FileAccess.open(arguments()[0], FileAccess.READ)
	while file.get_position() < file.get_length():
		var message := Message.parse(file.get_buffer(file.get_32()))
		if message == null:
			tell({"damaged": true})
		elif message.kind == Message.Kind.SCENE:
			tell(_header(message).merged(_scene(Scene.parse(message.payload)), true))
		else:
			tell(_header(message).merged({"payload": base64(message.payload), "json": message.json()}))
	quit()


func _header(message: Message) -> Dictionary:
	return {
		"topic": message.topic,
		"major": message.major,
		"minor": message.minor,
		"kind": message.kind,
		"state": message.state,
		"user": message.user,
		"revision": message.revision,
		"sequence": str(message.sequence),
		"time": message.time,
		"received": str(message.received),
		"published": str(message.published),
		"root": [message.root.x, message.root.y, message.root.z],
		"length": message.payload.size(),
		"targets": base64(message.targets.to_byte_array()),
		"is_frame": message.is_frame(),
	}


func _scene(scene: Scene) -> Dictionary:
	if scene == null:
		return {"damaged": true}
	return {
		"facts": scene.description,
		"scene_revision": scene.revision,
		"counts": [scene.vertex_count, scene.triangle_count, scene.field_count, scene.isoline_count],
		"weights": base64(scene.weights.to_byte_array()),
		"triangles": base64(scene.triangles.to_byte_array()),
		"positions": base64(scene.positions.to_byte_array()),
		"normals": base64(scene.normals.to_byte_array()),
		"ladder": base64(scene.isoline_coordinates.to_byte_array()),
		"slopes": base64(scene.slopes.to_byte_array()),
		"uv": base64(scene.uv.to_byte_array()),
		"colors": base64(scene.colors.to_byte_array()),
		"parts": scene.parts,
		"bounds": [_list(scene.bounds.position), _list(scene.bounds.end)],
		"diagonal": scene.diagonal,
		"handles": scene.handles.map(func(each: Dictionary) -> Dictionary: return _handle(each)),
		"joints": scene.joints,
		"morphs": scene.morphs,
	}


func _handle(handle: Dictionary) -> Dictionary:
	return {"name": handle.name, "position": _list(handle.position), "joints": handle.joints}


func _list(vector: Vector3) -> Array:
	return [vector.x, vector.y, vector.z]
