@tool
class_name PuppetClip
extends Resource
## A character and its motion, from `puppetline clip`. A [Puppet3D] plays it without a service.
##
## Import a .clip file like any other file of the project.

const Message := preload("wire/message.gd")
const Scene := preload("wire/scene.gd")
const SharedScene := preload("play/shared_scene.gd")

const _HEADER_BYTES := 128
const _LENGTH_OFFSET := 76

## The contents of the file.
@export var data := PackedByteArray():
	set(value):
		data = value
		_is_read = false
		emit_changed()

var _is_read := false
var _facts: Dictionary = {}
var _starts := PackedInt64Array()  # of the frames, in the data
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


## Return the number of frames per second.
func frames_per_second() -> float:
	_read()
	return float(_facts.get("fps", 30.0))


## Return the duration in seconds.
func length() -> float:
	return (frame_count() - 1) / frames_per_second() if frame_count() > 0 else 0.0


## Return a frame.
func frame(number: int) -> Message:
	_read()
	return Message.parse(_message_at(_starts[number]))


## Return the scene and the resources made from it, which all nodes that play this clip share.
func shared_scene() -> SharedScene:
	_read()
	return _shared


func _read() -> void:
	if _is_read:
		return
	_is_read = true
	_facts = {}
	_starts.clear()
	_shared = null
	_problem = _read_messages()
	if _problem:
		_starts.clear()
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
			var scene := Scene.parse(message.payload)
			if scene == null:
				return "a damaged scene"
			_shared = SharedScene.of_scene(scene)
		else:
			_starts.append(at)
		if message.revision != revision:
			return "a frame of another scene at byte %d" % at
		at += _HEADER_BYTES + message.payload.size()
		number += 1
	if _starts.is_empty() or _starts.size() != int(_facts.get("frames", -1)):
		return "%d frames, and %s are described" % [_starts.size(), _facts.get("frames", "none")]
	return ""


func _message_at(at: int) -> PackedByteArray:
	if at + _HEADER_BYTES > data.size():
		return PackedByteArray()
	return data.slice(at, at + _HEADER_BYTES + data.decode_u32(at + _LENGTH_OFFSET))
