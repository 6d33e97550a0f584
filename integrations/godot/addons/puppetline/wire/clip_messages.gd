extends RefCounted
## What the data of a clip file contains (docs/clips.md).

const ClipMessages := preload("clip_messages.gd")
const ClipFile := preload("clip_file.gd")
const Message := preload("message.gd")

## Description of an error in the data; empty if there is none. With an error, there are no frames.
var problem := ""
## Name of the character.
var character := ""
## Payload of the scene.
var scene := PackedByteArray()
## Times of the frames in seconds.
var times := PackedFloat64Array()

var _data := PackedByteArray()
var _facts: Dictionary = {}
var _starts := PackedInt64Array()  # of the frames, in the data


## Find the messages in the data of a file.
static func find(data: PackedByteArray) -> ClipMessages:
	var found := ClipMessages.new()
	found._data = data
	var problem := found._find()
	found.character = str(found._facts.get("character", ""))
	if problem:
		found.fail(problem)
	return found


## Keep the description of an error, and remove the scene and the frames.
func fail(because: String) -> void:
	problem = because
	scene.clear()
	times.clear()
	_starts.clear()


## Return a frame.
func frame(number: int) -> Message:
	return Message.parse(_message_at(_starts[number]))


## Find the messages; return a description of an error.
func _find() -> String:
	var kinds := PackedInt32Array([Message.Kind.CLIP, Message.Kind.SCENE])
	var revision := 0
	var at := 0
	var number := 0
	while at < _data.size():
		var message := Message.parse(_message_at(at))
		var expected := kinds[number] if number < 2 else Message.Kind.CONTROLS
		if message == null or message.major != Message.MAJOR or message.kind != expected:
			return "damaged at byte %d" % at
		if number == 0:
			var facts: Variant = message.json()
			_facts = facts if facts is Dictionary else {}
			revision = message.revision
		elif number == 1:
			scene = message.payload
		elif not times.is_empty() and message.time <= times[-1]:
			return "a frame that is not later than the one before at byte %d" % at
		else:
			_starts.append(at)
			times.append(message.time)
		if message.revision != revision:
			return "a frame of another scene at byte %d" % at
		at += ClipFile.size_at(_data, at)
		number += 1
	if _starts.is_empty() or _starts.size() != int(_facts.get("frames", -1)):
		return "%d frames, and %s are described" % [_starts.size(), _facts.get("frames", "none")]
	return ""


func _message_at(at: int) -> PackedByteArray:
	if at + ClipFile.HEADER_BYTES > _data.size():
		return PackedByteArray()
	return _data.slice(at, at + ClipFile.size_at(_data, at))
