extends "teller.gd"
## Attaches nodes to a character of a running service, below a parent with a transform, and reports their poses:
## {"puppet": properties, "parent": 12 numbers (columns and origin), "attachments": a list of properties, "samples":
## number of frames, "apart": frames between two samples, "file": path of the positions of all vertices, those at rest
## first}.

var _asked: Dictionary
var _puppet := Puppet3D.new()
var _attachments: Array[PuppetAttachment3D] = []
var _file: FileAccess
var _next := 0
var _samples := 0


func start() -> void:
	_asked = JSON.parse_string(arguments()[0])
	_file = FileAccess.open(_asked["file"], FileAccess.WRITE)
	var parent := Node3D.new()
	var n: Array = _asked["parent"]
	parent.transform = Transform3D(
		Vector3(n[0], n[1], n[2]), Vector3(n[3], n[4], n[5]), Vector3(n[6], n[7], n[8]), Vector3(n[9], n[10], n[11])
	)
	root.add_child(parent)
	_apply(_puppet, _asked["puppet"])
	_puppet.scene_loaded.connect(
		func() -> void: _file.store_buffer(_puppet.evaluate().to_byte_array()), CONNECT_ONE_SHOT
	)
	for properties: Dictionary in _asked["attachments"]:
		var attachment := PuppetAttachment3D.new()
		attachment.puppet = _puppet
		_apply(attachment, properties)
		_attachments.append(attachment)
		(_puppet if _attachments.size() % 2 else parent).add_child(attachment)
	parent.add_child(_puppet)


func _sample() -> void:
	var shown := _puppet.statistics()
	if not shown["calibrated"] or shown["sequence"] < _next or _samples == _asked["samples"]:
		return
	_next = shown["sequence"] + int(_asked["apart"])
	_samples += 1
	_file.store_buffer(_puppet.evaluate().to_byte_array())
	var poses := _attachments.map(func(each: PuppetAttachment3D) -> Array: return _numbers(each.global_transform))
	var vertices := _attachments.map(func(each: PuppetAttachment3D) -> Array: return _surface(each.vertex))
	tell({"poses": poses, "surface": vertices, "puppet": _numbers(_puppet.global_transform)})


## Report the poses that the nodes have had since the previous frame.
func step(_delta: float) -> bool:
	_sample()
	if _samples == _asked["samples"]:
		for attachment in _attachments:
			tell({"warnings": attachment._get_configuration_warnings()})
		_puppet.get_parent().free()
		return true
	return false


func _apply(node: Node, properties: Dictionary) -> void:
	for property: String in properties:
		node.set(property, load(properties[property]) if property == "mesh_source" else properties[property])


func _surface(vertex: int) -> Array:
	return _numbers(_puppet.get_surface_transform(vertex))


func _numbers(transform: Transform3D) -> Array:
	var numbers: Array = []
	for column in [transform.basis.x, transform.basis.y, transform.basis.z, transform.origin]:
		numbers.append_array([column.x, column.y, column.z])
	return numbers
