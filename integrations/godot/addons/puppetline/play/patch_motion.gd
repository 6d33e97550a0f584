extends RefCounted
## The motion of a patch of a character's surface. Each frame is evaluated once, and interpolated for each image.

const Message := preload("../wire/message.gd")
const SurfacePatch := preload("surface_patch.gd")

var patch: SurfacePatch

var _frames: Array[Message] = [null, null]
var _sums: Array[PackedVector3Array] = [PackedVector3Array(), PackedVector3Array()]


## Return the sums of a patch between two frames: origin and two axes.
func between(earlier: Message, later: Message, share: float) -> PackedVector3Array:
	# Of two frames, one is usually known from the previous image. Its slot stays.
	var first := 1 if _frames[1] == earlier or (_frames[0] == later and earlier != later) else 0
	_evaluate(first, earlier)
	_evaluate(1 - first, later)
	var from := _sums[first]
	var to := _sums[1 - first]
	return PackedVector3Array([from[0].lerp(to[0], share), from[1].lerp(to[1], share), from[2].lerp(to[2], share)])


## Compute the sums in one frame.
func evaluate(_frame: Message) -> PackedVector3Array:
	return PackedVector3Array()


func _evaluate(slot: int, frame: Message) -> void:
	if _frames[slot] != frame:
		_frames[slot] = frame
		_sums[slot] = evaluate(frame)
