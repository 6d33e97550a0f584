extends "teller.gd"
## Reports the signals of a PuppetOscReceiver: PORT CHARACTER.

var _receiver := PuppetOscReceiver.new()


func start() -> void:
	_receiver.port = int(arguments()[0])
	_receiver.character = arguments()[1]
	_receiver.joints_received.connect(
		func(of: String, names: PackedStringArray, places: PackedVector3Array, confidence: PackedFloat32Array) -> void:
			tell({"signal": "joints", "of": of, "names": names, "places": _list(places), "confidence": confidence})
	)
	_receiver.handles_received.connect(
		func(of: String, names: PackedStringArray, places: PackedVector3Array) -> void:
			tell({"signal": "handles", "of": of, "names": names, "places": _list(places)})
	)
	_receiver.controls_received.connect(
		func(of: String, transforms: PackedFloat32Array) -> void:
			tell({"signal": "controls", "of": of, "numbers": transforms})
	)
	_receiver.weights_received.connect(
		func(of: String, weights: PackedFloat32Array) -> void: tell({"signal": "weights", "of": of, "numbers": weights})
	)
	_receiver.root_received.connect(
		func(of: String, place: Vector3) -> void:
			tell({"signal": "root", "of": of, "places": _list(PackedVector3Array([place]))})
	)
	_receiver.performer_received.connect(
		func(of: String, state: String, user: int) -> void:
			tell({"signal": "performer", "of": of, "state": state, "user": user})
	)
	_receiver.message_received.connect(
		func(address: String, arguments: Array) -> void:
			tell({"signal": "message", "address": address, "arguments": arguments})
	)
	root.add_child(_receiver)
	tell({"signal": "ready"})


func step(_delta: float) -> bool:
	return is_over()


func _list(places: PackedVector3Array) -> Array:
	return Array(places).map(func(place: Vector3) -> Array: return [place.x, place.y, place.z])
