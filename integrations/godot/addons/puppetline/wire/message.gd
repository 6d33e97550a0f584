extends RefCounted
## A message of the stream taken apart: topic, header, payload (docs/protocol.md, "Messages").

## What a payload is.
enum Kind { SCENE = 1, CONTROLS, MORPHS, VERTICES, VERTICES16, JOINTS, HANDLES, PERFORMER, STATUS, CHARACTERS }
## Nobody performs; the rest pose is being taken; the performer moves the character; it eases to rest.
enum PerformerState { WAITING, CALIBRATING, PERFORMING, LEAVING }

const Message := preload("message.gd")

## The version of the protocol that this addon speaks. Of a message of another one, only topic and version are read.
const MAJOR := 1
## The user of a message that nobody performs.
const NOBODY := -1

const _TOPIC := 64
const _BEFORE_PAYLOAD := 128

var topic := ""
var major := 0
var minor := 0
## One of [enum Kind], or a number that a later minor version has added.
var kind := 0
## One of [enum PerformerState].
var state := 0
## The source's number of the performer, or [constant NOBODY].
var user := NOBODY
## Of the scene that the message belongs to.
var revision := 0
## One more with each frame of the character.
var sequence := 0
## Seconds on the source's clock.
var time := 0.0
## Nanoseconds of the service's clock: when what moved the character came in there.
var received := 0
## Nanoseconds of the service's clock: when this message was made.
var published := 0
## How far the whole character has walked, file coordinates.
var root := Vector3.ZERO
var payload := PackedByteArray()


## Read a message; null if it is damaged.
static func parse(bytes: PackedByteArray) -> Message:
	if bytes.size() < _BEFORE_PAYLOAD:
		return null
	var message := Message.new()
	message.topic = _read_topic(bytes)
	if message.topic.is_empty():
		return null
	message.major = bytes[_TOPIC]
	message.minor = bytes[_TOPIC + 1]
	if message.major == 0 or (message.major == MAJOR and not message._read(bytes)):
		return null
	return message


## Tell whether this is part of the motion, and not said only when it changes or is asked for.
func is_frame() -> bool:
	return kind >= Kind.CONTROLS and kind <= Kind.HANDLES


## Read a payload of JSON; null if it is damaged.
func json() -> Variant:
	var reader := JSON.new()
	return reader.data if reader.parse(payload.get_string_from_utf8()) == OK else null


## Return the printable characters that end with the first of the zeros; nothing if there is anything else.
static func _read_topic(bytes: PackedByteArray) -> String:
	var end := bytes.find(0)
	if end >= _TOPIC or bytes.slice(end, _TOPIC).count(0) < _TOPIC - end:
		return ""
	for i in end:
		if bytes[i] < 0x20 or bytes[i] > 0x7E:
			return ""
	return bytes.slice(0, end).get_string_from_ascii()


func _read(bytes: PackedByteArray) -> bool:
	kind = bytes[_TOPIC + 2]
	state = bytes[_TOPIC + 3]
	user = bytes.decode_s32(_TOPIC + 4)
	revision = bytes.decode_u32(_TOPIC + 8)
	var length := bytes.decode_u32(_TOPIC + 12)
	sequence = bytes.decode_u64(_TOPIC + 16)
	time = bytes.decode_double(_TOPIC + 24)
	received = bytes.decode_u64(_TOPIC + 32)
	published = bytes.decode_u64(_TOPIC + 40)
	root.x = bytes.decode_float(_TOPIC + 48)
	root.y = bytes.decode_float(_TOPIC + 52)
	root.z = bytes.decode_float(_TOPIC + 56)
	if state > PerformerState.LEAVING or not is_finite(time) or not root.is_finite():
		return false
	if length > bytes.size() - _BEFORE_PAYLOAD:
		return false
	payload = bytes.slice(_BEFORE_PAYLOAD, _BEFORE_PAYLOAD + length)
	return true
