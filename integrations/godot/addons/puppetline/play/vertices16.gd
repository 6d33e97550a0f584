extends RefCounted
## Functions that read the payload of a frame of vertices: a box, positions in its 65,535 steps, and normals
## (docs/protocol.md, "Vertices16").

## Size of a number, in bytes. The box comes first, as six numbers of 32 bits.
const NUMBER_BYTES := 2
const _BOX_BYTES := 24
## Number of steps along each side of the box.
const STEPS := 65535


## Return the size of the payload, in bytes.
static func size(vertex_count: int) -> int:
	return NUMBER_BYTES * (normals_start(vertex_count) + 2 * vertex_count)


## Return how many 16-bit numbers come before the positions; each vertex has three.
static func positions_start() -> int:
	return _BOX_BYTES / NUMBER_BYTES


## Return how many 16-bit numbers come before the normals; each vertex has two.
static func normals_start(vertex_count: int) -> int:
	return positions_start() + 3 * vertex_count + (3 * vertex_count) % 2


## Return the box of the frame; it may not be finite.
static func box(payload: PackedByteArray) -> AABB:
	var low := Vector3(payload.decode_float(0), payload.decode_float(4), payload.decode_float(8))
	var high := Vector3(payload.decode_float(12), payload.decode_float(16), payload.decode_float(20))
	return AABB(low, high - low)


## Return the position of a vertex in a frame with a box.
static func position(payload: PackedByteArray, within: AABB, vertex: int) -> Vector3:
	var at := _BOX_BYTES + 3 * NUMBER_BYTES * vertex
	var steps := Vector3(payload.decode_u16(at), payload.decode_u16(at + 2), payload.decode_u16(at + 4))
	return within.position + steps / STEPS * within.size
