@tool
class_name PuppetClip
extends Resource
## A character and its motion, from `puppetline clip` or a [PuppetRecorder]. A [Puppet3D] plays it without a service.
##
## Import a .clip file like any other file of the project.

const Message := preload("wire/message.gd")
const ClipFile := preload("wire/clip_file.gd")
const SharedScene := preload("play/shared_scene.gd")

## The contents of the file.
@export var data := PackedByteArray():
	set(value):
		data = value
		_is_read = false
		emit_changed()

var _is_read := false
var _facts: Dictionary = {}
var _starts := PackedInt64Array()  # of the frames, in the data
var _times := PackedFloat64Array()  # of the frames, in seconds
var _shared: SharedScene
var _problem := ""


## Return a description of an error in the data; empty if there is none.
func problem() -> String:
	_read()
	return _problem


## Return the name of the character.
func character() -> String:
	_read()
	return str(_facts.get("character", ""))


## Return the number of frames.
func frame_count() -> int:
	_read()
	return _starts.size()


## Return the duration in seconds.
func length() -> float:
	return _times[-1] - _times[0] if frame_count() > 0 else 0.0


## Return the number of the last frame that is not after a position in seconds, the first one for earlier positions.
func frame_at(position: float) -> int:
	return maxi(_times.bsearch(_times[0] + position, false) - 1, 0) if frame_count() > 0 else -1


## Return the position of a frame in seconds.
func frame_position(number: int) -> float:
	_read()
	return _times[number] - _times[0]


## Return the revision of the scene to which the frames belong.
func revision() -> int:
	_read()
	return _shared.scene.revision if _shared != null else 0


## Return a frame.
func frame(number: int) -> Message:
	_read()
	return Message.parse(_message_at(_starts[number]))


## Return the scene and the resources made from it, which all clips of the same scene share; null in a damaged clip.
func shared_scene() -> SharedScene:
	_read()
	return _shared


func _read() -> void:
	if _is_read:
		return
	_is_read = true
	_facts = {}
	_forget()
	_problem = _read_messages()
	if _problem:
		_forget()


func _forget() -> void:
	_starts.clear()
	_times.clear()
	_shared = null


## Find the messages of the data; return a description of an error.
func _read_messages() -> String:
	var kinds := PackedInt32Array([Message.Kind.CLIP, Message.Kind.SCENE])
	var revision := 0
	var at := 0
	var number := 0
	while at < data.size():
		var message := Message.parse(_message_at(at))
		var expected := kinds[number] if number < 2 else Message.Kind.CONTROLS
		if message == null or message.major != Message.MAJOR or message.kind != expected:
			return "damaged at byte %d" % at
		if number == 0:
			var facts: Variant = message.json()
			_facts = facts if facts is Dictionary else {}
			revision = message.revision
		elif number == 1:
			_shared = SharedScene.of_payload(message.payload)
			if _shared == null:
				return "a damaged scene"
		elif not _times.is_empty() and message.time <= _times[-1]:
			return "a frame that is not later than the one before at byte %d" % at
		else:
			_starts.append(at)
			_times.append(message.time)
		if message.revision != revision:
			return "a frame of another scene at byte %d" % at
		at += ClipFile.HEADER_BYTES + message.payload.size()
		number += 1
	if _starts.is_empty() or _starts.size() != int(_facts.get("frames", -1)):
		return "%d frames, and %s are described" % [_starts.size(), _facts.get("frames", "none")]
	return ""


func _message_at(at: int) -> PackedByteArray:
	if at + ClipFile.HEADER_BYTES > data.size():
		return PackedByteArray()
	return data.slice(at, at + ClipFile.HEADER_BYTES + data.decode_u32(at + ClipFile.LENGTH_OFFSET))
