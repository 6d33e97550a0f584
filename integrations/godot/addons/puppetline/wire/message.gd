extends RefCounted
## A message of the stream: topic, header and payload (docs/protocol.md, "Messages").

## Type of a payload.
enum Kind {
	SCENE = 1,
	CONTROLS,
	MORPHS,
	VERTICES,
	VERTICES16,
	JOINTS,
	HANDLES,
	PERFORMER,
	STATUS,
	CHARACTERS,
	CLIP,
	BONES,
	CHANNELS,
}
## There is no performer; the performer is being calibrated; the performer drives the character; the character eases
## into its rest pose.
enum PerformerState { WAITING, CALIBRATING, PERFORMING, LEAVING }

const Message := preload("message.gd")

## Major version of the protocol that this addon supports. Of messages of other versions, only topic and version are
## read.
const MAJOR := 1
## User number of a message without a performer.
const NO_USER := -1

const _TOPIC_BYTES := 64
const _HEADER_BYTES := 128

var topic := ""
var major := 0
var minor := 0
## One of [enum Kind], or a number that a later minor version has added.
var kind := 0
## One of [enum PerformerState].
var state := 0
## The source's user number of the performer, or [constant NO_USER].
var user := NO_USER
## Revision of the scene that the message belongs to.
var revision := 0
## Number of the frame; it increases by one with each frame of the character.
var sequence := 0
## Time of the frame on the source's clock, in seconds.
var time := 0.0
## Time at which the service received the data that moved the character, in nanoseconds of the service's clock.
var received := 0
## Time at which the service made this message, in nanoseconds of the service's clock.
var published := 0
## Displacement of the whole character by root motion, in file coordinates.
var root := Vector3.ZERO
## Weights of the mesh's own morph targets, in the order of the scene's `targets`; empty if nothing moves them.
var targets := PackedFloat32Array()
var payload := PackedByteArray():
	get:
		if not _bytes.is_empty():
			payload = _bytes.slice(_HEADER_BYTES, _HEADER_BYTES + _length)
			_bytes = PackedByteArray()
		return payload

var _bytes := PackedByteArray()  # the whole message, before the payload is copied from it
var _length := 0
var _rows := PackedVector4Array()


## Read a message; null if it is damaged.
static func parse(bytes: PackedByteArray) -> Message:
	if bytes.size() < _HEADER_BYTES:
		return null
	var message := Message.new()
	message.topic = _read_topic(bytes)
	if message.topic.is_empty():
		return null
	message.major = bytes[_TOPIC_BYTES]
	message.minor = bytes[_TOPIC_BYTES + 1]
	if message.major == 0 or (message.major == MAJOR and not message._read(bytes)):
		return null
	return message


## Return the bytes of the message, from which [method parse] reads it.
func encode() -> PackedByteArray:
	var bytes := topic.to_ascii_buffer()
	bytes.resize(_HEADER_BYTES)
	bytes[_TOPIC_BYTES] = major
	bytes[_TOPIC_BYTES + 1] = minor
	bytes[_TOPIC_BYTES + 2] = kind
	bytes[_TOPIC_BYTES + 3] = state
	bytes.encode_s32(_TOPIC_BYTES + 4, user)
	bytes.encode_u32(_TOPIC_BYTES + 8, revision)
	bytes.encode_u32(_TOPIC_BYTES + 12, payload.size())
	bytes.encode_u64(_TOPIC_BYTES + 16, sequence)
	bytes.encode_double(_TOPIC_BYTES + 24, time)
	bytes.encode_u64(_TOPIC_BYTES + 32, received)
	bytes.encode_u64(_TOPIC_BYTES + 40, published)
	for axis in 3:
		bytes.encode_float(_TOPIC_BYTES + 48 + 4 * axis, root[axis])
	bytes.encode_u32(_TOPIC_BYTES + 60, targets.size())
	return bytes + payload + targets.to_byte_array()


## Return whether this message is a frame of the motion. Other messages are sent on changes or on request.
func is_frame() -> bool:
	return (kind >= Kind.CONTROLS and kind <= Kind.HANDLES) or kind == Kind.BONES or kind == Kind.CHANNELS


## Return the JSON value of the payload; null if it is damaged.
func json() -> Variant:
	var reader := JSON.new()
	return reader.data if reader.parse(payload.get_string_from_utf8()) == OK else null


## Return the rows of all transforms of controls, three per transform. They are decoded once, in the format of [method
## @GlobalScope.var_to_bytes], which needs no loop.
func rows() -> PackedVector4Array:
	if _rows.is_empty():
		var written := PackedByteArray()
		written.resize(8)
		written.encode_u32(0, TYPE_PACKED_VECTOR4_ARRAY)
		written.encode_u32(4, payload.size() / 16)
		written.append_array(payload)
		_rows = bytes_to_var(written)
	return _rows


## Return the printable characters before the zero padding; empty if the field contains anything else.
static func _read_topic(bytes: PackedByteArray) -> String:
	var end := bytes.find(0)
	if end >= _TOPIC_BYTES or bytes.slice(end, _TOPIC_BYTES).count(0) < _TOPIC_BYTES - end:
		return ""
	for i in end:
		if bytes[i] < 0x20 or bytes[i] > 0x7E:
			return ""
	return bytes.slice(0, end).get_string_from_ascii()


func _read(bytes: PackedByteArray) -> bool:
	kind = bytes[_TOPIC_BYTES + 2]
	state = bytes[_TOPIC_BYTES + 3]
	user = bytes.decode_s32(_TOPIC_BYTES + 4)
	revision = bytes.decode_u32(_TOPIC_BYTES + 8)
	_length = bytes.decode_u32(_TOPIC_BYTES + 12)
	sequence = bytes.decode_u64(_TOPIC_BYTES + 16)
	time = bytes.decode_double(_TOPIC_BYTES + 24)
	received = bytes.decode_u64(_TOPIC_BYTES + 32)
	published = bytes.decode_u64(_TOPIC_BYTES + 40)
	root.x = bytes.decode_float(_TOPIC_BYTES + 48)
	root.y = bytes.decode_float(_TOPIC_BYTES + 52)
	root.z = bytes.decode_float(_TOPIC_BYTES + 56)
	if state > PerformerState.LEAVING or not is_finite(time) or not root.is_finite():
		return false
	var target_bytes := 4 * bytes.decode_u32(_TOPIC_BYTES + 60)
	var end := _HEADER_BYTES + _length
	if end + target_bytes > bytes.size():
		return false
	if target_bytes > 0:
		targets = bytes.slice(end, end + target_bytes).to_float32_array()
		for weight in targets:
			if not (weight >= 0.0 and weight <= 1.0):
				return false
	_bytes = bytes
	return true
