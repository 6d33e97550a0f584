extends "teller.gd"
## Shows characters, and reports their signals and regularly their state. The arguments are a JSON list of their
## properties, and a file of commands, one JSON object per line: {"puppet": number, "set": {…}} or
## {"puppet": number, "call": [method, argument…]}.

const INTERVAL := 0.1
## Signals of each image or frame, which are not reported.
const FREQUENT := ["pose_updated", "frame_received"]

var _puppets: Array[Puppet3D] = []
var _done := 0
var _told_at := 0.0


func start() -> void:
	for settings: Dictionary in JSON.parse_string(arguments()[0]):
		var puppet := Puppet3D.new()
		_apply(puppet, settings)
		_listen(puppet, _puppets.size())
		_puppets.append(puppet)
		root.add_child(puppet)


func step(delta: float) -> bool:
	_told_at -= delta
	if FileAccess.file_exists(arguments()[1]):
		_obey(FileAccess.get_file_as_string(arguments()[1]).split("\n", false))
	if _told_at <= 0.0:
		_told_at = INTERVAL
		for i in _puppets.size():
			tell(_state(_puppets[i]).merged({"puppet": i, "done": _done}))
	if is_over():
		for puppet in _puppets:
			puppet.free()
	return is_over()


func _listen(puppet: Puppet3D, number: int) -> void:
	for happening: Dictionary in puppet.get_script().get_script_signal_list():
		var name: String = happening["name"]
		var hear := func(what: Variant = null) -> void: tell({"puppet": number, "signal": name, "what": what})
		if name not in FREQUENT:
			puppet.connect(name, hear)


func _obey(lines: PackedStringArray) -> void:
	for line in lines.slice(_done):
		var wanted: Dictionary = JSON.parse_string(line)
		var puppet := _puppets[wanted["puppet"]]
		_apply(puppet, wanted.get("set", {}))
		if "request" in wanted:
			puppet.request(wanted["request"], func(reply: Dictionary) -> void: tell({"reply": reply}))
		if "call" in wanted:
			puppet.callv(wanted["call"][0], wanted["call"].slice(1))
		_done += 1


func _apply(puppet: Puppet3D, settings: Dictionary) -> void:
	for property: String in settings:
		puppet.set(property, load(settings[property]) if property == "mesh_source" else settings[property])


func _state(puppet: Puppet3D) -> Dictionary:
	var meshes := puppet.find_children("*", "MeshInstance3D", true, false)
	var packed := PackedScene.new()
	packed.pack(puppet)
	return puppet.statistics().merged(
		{
			"meshes": meshes.map(func(mesh: MeshInstance3D) -> String: return str(mesh.mesh.get_rid().get_id())),
			"instances": meshes.map(func(mesh: MeshInstance3D) -> String: return str(mesh.get_instance_id())),
			"visible": meshes.map(func(mesh: MeshInstance3D) -> bool: return mesh.is_visible_in_tree()),
			"rendering": meshes.map(_rendering),
			"warnings": puppet._get_configuration_warnings(),
			"saved": packed.get_state().get_node_count(),
		}
	)


func _rendering(mesh: MeshInstance3D) -> Array:
	return [mesh.layers, mesh.cast_shadow, mesh.gi_mode, mesh.lod_bias, mesh.visibility_range_end]
