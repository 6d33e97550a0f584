@tool
class_name PuppetClip
extends Resource
## A character and its motion, from `puppetline clip` or a [PuppetRecorder]. A [Puppet3D] plays it without a service.
##
## Import a .clip file like any other file of the project.

const Message := preload("wire/message.gd")
const ClipMessages := preload("wire/clip_messages.gd")
const ClipLoading := preload("play/clip_loading.gd")
const SharedScene := preload("play/shared_scene.gd")

## The contents of the file.
@export var data := PackedByteArray():
	set(value):
		data = value
		_messages = null
		_shared = null
		_loading = null
		emit_changed()

var _messages: ClipMessages  # null before the data has been read
var _shared: SharedScene
var _loading: ClipLoading


## Read the data in a thread, which also makes what the graphics card needs; the mesh only if [param with_mesh]. Return
## whether that is done. The other functions read the data immediately if it has not been read.
func load_in_thread(with_mesh: bool) -> bool:
	if _messages != null:
		return true
	if _loading == null:
		_loading = ClipLoading.in_thread(data, SharedScene.known_resources(), with_mesh)
	elif _loading.is_done():
		_take(_loading)
	return _messages != null


## Return a description of an error in the data; empty if there is none.
func problem() -> String:
	return _read().problem


## Return the name of the character.
func character() -> String:
	return _read().character


## Return the number of frames.
func frame_count() -> int:
	return _read().times.size()


## Return the duration in seconds.
func length() -> float:
	return frame_position(frame_count() - 1) if frame_count() > 0 else 0.0


## Return the number of the last frame that is not after a position in seconds, the first one for earlier positions.
func frame_at(position: float) -> int:
	var times := _read().times
	return maxi(times.bsearch(times[0] + position, false) - 1, 0) if not times.is_empty() else -1


## Return the position of a frame in seconds.
func frame_position(number: int) -> float:
	return _read().times[number] - _messages.times[0]


## Return the revision of the scene to which the frames belong.
func revision() -> int:
	return shared_scene().scene.revision if shared_scene() != null else 0


## Return a frame.
func frame(number: int) -> Message:
	return _read().frame(number)


## Return the scene and the resources made from it, which all clips of the same scene share; null in a damaged clip.
func shared_scene() -> SharedScene:
	_read()
	return _shared


func _read() -> ClipMessages:
	if _messages == null:
		_take(ClipLoading.at_once(data, SharedScene.known_resources()))
	return _messages


func _take(loaded: ClipLoading) -> void:
	_loading = null
	_messages = loaded.messages
	_shared = SharedScene.of_resources(loaded.resources, loaded.digest) if loaded.resources != null else null
