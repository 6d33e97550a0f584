extends RefCounted
## The parts of a clip file (docs/clips.md), which can be written one after another while frames arrive.

const Message := preload("message.gd")
const Scene := preload("scene.gd")

const HEADER_BYTES := 128
const _LENGTH_OFFSET := 76
const _TARGETS_OFFSET := 124
## Size of the description, in bytes. It is padded with spaces, so that the number of frames can be written last.
const _DESCRIPTION_BYTES := 512


## Return the messages before the first frame, for a number of frames that is not known yet.
static func beginning(character: String, recording: String, scene: Scene) -> PackedByteArray:
	var facts := {"character": character, "revision": scene.revision, "frames": 0, "fps": 30.0, "recording": recording}
	var bytes := _description(character, scene.revision, facts)
	bytes.append_array(_message(character + "/scene", Message.Kind.SCENE, scene.revision, scene.encoded).encode())
	return bytes


## Return the message of a frame with a number, at a time in seconds from the first frame.
static func frame(character: String, received: Message, number: int, time: float) -> PackedByteArray:
	var message := _message(character + "/controls", Message.Kind.CONTROLS, received.revision, received.payload)
	message.state = received.state
	message.sequence = number
	message.time = time
	message.root = received.root
	message.targets = received.targets
	return message.encode()


## Return a file without an incomplete message at its end, and with its number of frames; empty if it has no frames.
static func completed(bytes: PackedByteArray) -> PackedByteArray:
	var count := -2  # description and scene
	var end := 0
	var last: Message = null
	while end + HEADER_BYTES <= bytes.size():
		var next := end + size_at(bytes, end)
		if next > bytes.size():
			break
		last = Message.parse(bytes.slice(end, next))
		end = next
		count += 1
	var first := Message.parse(bytes)
	var facts: Variant = first.json() if first != null else null
	if count <= 0 or last == null or not facts is Dictionary:
		return PackedByteArray()
	facts["frames"] = count
	facts["revision"] = first.revision
	facts["fps"] = (count - 1) / last.time if last.time > 0.0 else 30.0
	var whole := _description(str(facts.get("character", "")), first.revision, facts)
	whole.append_array(bytes.slice(whole.size(), end))
	return whole


## Return the size of the message whose header is at a byte, in bytes.
static func size_at(bytes: PackedByteArray, at: int) -> int:
	return HEADER_BYTES + bytes.decode_u32(at + _LENGTH_OFFSET) + 4 * bytes.decode_u32(at + _TARGETS_OFFSET)


static func _description(character: String, revision: int, facts: Dictionary) -> PackedByteArray:
	var text := JSON.stringify(facts).to_utf8_buffer()
	var length := text.size()
	text.resize(_DESCRIPTION_BYTES)
	for i in range(length, _DESCRIPTION_BYTES):
		text[i] = 0x20
	return _message(character + "/clip", Message.Kind.CLIP, revision, text).encode()


static func _message(topic: String, kind: Message.Kind, revision: int, payload: PackedByteArray) -> Message:
	var message := Message.new()
	message.topic = topic
	message.major = Message.MAJOR
	message.kind = kind
	message.revision = revision
	message.payload = payload
	return message
