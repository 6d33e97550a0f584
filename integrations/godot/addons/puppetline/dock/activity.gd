@tool
extends RefCounted
## How much each handle of a character moves just now.

const Message := preload("../wire/message.gd")

## Seconds in which a handle that has come to rest is shown as one.
const FADE := 0.4
## Of the handles' own extent, how far a handle goes in a second that moves as much as is shown.
const FULL := 1.0

## From 0, at rest, to 1, one a handle.
var shares := PackedFloat32Array()

var _places := PackedVector3Array()
var _time := -1.0


## Take a frame of the topic `handles`.
func take(message: Message) -> void:
	var count := message.payload.size() / 12
	if message.kind != Message.Kind.HANDLES or count == 0:
		return
	var floats := message.payload.slice(0, 12 * count).to_float32_array()
	var places := PackedVector3Array()
	var box := AABB()
	for i in count:
		var place := Vector3(floats[3 * i], floats[3 * i + 1], floats[3 * i + 2]) - message.root
		places.append(place)
		box = AABB(place, Vector3.ZERO) if i == 0 else box.expand(place)
	var passed := message.time - _time
	if places.size() == _places.size() and passed > 0.0 and passed < 1.0:
		_compare(places, passed, maxf(box.get_longest_axis_size(), 1e-6))
	else:
		shares.resize(count)
		shares.fill(0.0)
	_places = places
	_time = message.time


func _compare(places: PackedVector3Array, passed: float, size: float) -> void:
	for i in places.size():
		var speed := places[i].distance_to(_places[i]) / passed / size
		shares[i] = maxf(minf(speed / FULL, 1.0), shares[i] - passed / FADE)
