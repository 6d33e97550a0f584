@tool
extends RefCounted
## Measurement of the current motion of each handle of a character.

const Message := preload("../wire/message.gd")

## Time in which the activity of a stopped handle decays from 1 to 0, in seconds.
const FADE_SECONDS := 0.4
## Speed that counts as full activity, in extents of all handles per second.
const FULL_SPEED := 1.0

## Activity per handle, from 0 (at rest) to 1.
var shares := PackedFloat32Array()

var _positions := PackedVector3Array()
var _time := -1.0


## Update the activity from a frame of the topic `handles`.
func take(message: Message) -> void:
	var count := message.payload.size() / 12
	if message.kind != Message.Kind.HANDLES or count == 0:
		return
	var floats := message.payload.slice(0, 12 * count).to_float32_array()
	var positions := PackedVector3Array()
	var box := AABB()
	for i in count:
		var position := Vector3(floats[3 * i], floats[3 * i + 1], floats[3 * i + 2]) - message.root
		positions.append(position)
		box = AABB(position, Vector3.ZERO) if i == 0 else box.expand(position)
	var elapsed := message.time - _time
	if positions.size() == _positions.size() and elapsed > 0.0 and elapsed < 1.0:
		_compare(positions, elapsed, maxf(box.get_longest_axis_size(), 1e-6))
	else:
		shares.resize(count)
		shares.fill(0.0)
	_positions = positions
	_time = message.time


func _compare(positions: PackedVector3Array, elapsed: float, size: float) -> void:
	for i in positions.size():
		var speed := positions[i].distance_to(_positions[i]) / elapsed / size
		shares[i] = maxf(minf(speed / FULL_SPEED, 1.0), shares[i] - elapsed / FADE_SECONDS)
