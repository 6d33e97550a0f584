@tool
@icon("icons/puppet_recorder.svg")
class_name PuppetRecorder
extends Node
## Records the performer of a [Puppet3D], in the game and in the editor, as a [PuppetClip] that plays without a service.
##
## The frames are recorded as the service sends them, in the mode CONTROLS. They are written to a file next to [member
## path] while they arrive. If the program ends before the recording, the next recorder with the same path saves it.

## Emitted when a recording has been saved.
signal saved(to: String)

const ClipFile := preload("wire/clip_file.gd")
const Message := preload("wire/message.gd")
const Playback := preload("play/playback.gd")

## Time between two frames that do not belong to one motion, in seconds: a pause of the service is not recorded.
const _CUT_SECONDS := 1.0 / 30.0
## Time since the last change after which a file counts as not being written any more, in seconds.
const _IDLE_SECONDS := 10.0
const _PART := ".part"

## The recorded character. If empty, the parent.
@export var puppet: Puppet3D
## File of the recording, with the extension `.res`. If it exists, a number is appended to the name. An exported game
## can only write below `user://`.
@export var path := "user://recording.res"

var _file: FileAccess  # null while nothing is recorded
var _followed: Puppet3D
var _last: Message
var _time := 0.0
var _count := 0


func _enter_tree() -> void:
	recover(path)


func _exit_tree() -> void:
	stop()


func _get_configuration_warnings() -> PackedStringArray:
	return [] if _wanted() != null else ["No character to record. Set puppet, or put the node below a Puppet3D."]


## Start a recording, which begins with the next frame. Return an error if there is no character or the file cannot be
## written.
func start() -> Error:
	if is_recording():
		return ERR_ALREADY_IN_USE
	if _wanted() == null:
		return ERR_UNCONFIGURED
	var part := "%s.%d-%d%s" % [path, OS.get_process_id(), Time.get_ticks_usec(), _PART]
	_file = FileAccess.open(part, FileAccess.WRITE_READ)
	if _file == null:
		return FileAccess.get_open_error()
	_last = null
	_time = 0.0
	_count = 0
	_followed = _wanted()
	_followed.frame_received.connect(_record)
	return OK


## Finish and save the recording; return it, or null if there are no frames or it could not be saved.
func stop() -> PuppetClip:
	if not is_recording():
		return null
	if is_instance_valid(_followed):
		_followed.frame_received.disconnect(_record)
	_followed = null
	var part := _file.get_path()
	_file.close()
	_file = null
	var to := _save(part, path)
	if to.is_empty():
		return null
	saved.emit(to)
	return load(to)


func is_recording() -> bool:
	return _file != null


## Return the duration of the recording so far, in seconds.
func get_duration() -> float:
	return _time


## Save the recordings to a path that were not finished because their program has ended; return the files. A recording
## that has changed within [param idle_seconds] is left alone, because another program may still be writing it.
static func recover(to: String, idle_seconds := _IDLE_SECONDS) -> PackedStringArray:
	var found := PackedStringArray()
	var folder := to.get_base_dir()
	for file in DirAccess.get_files_at(folder) if DirAccess.dir_exists_absolute(folder) else PackedStringArray():
		var part := folder.path_join(file)
		if not file.begins_with(to.get_file() + ".") or not file.ends_with(_PART):
			continue
		if Time.get_unix_time_from_system() - FileAccess.get_modified_time(part) >= idle_seconds:
			var kept := _save(part, to)
			if kept:
				found.append(kept)
	return found


func _wanted() -> Puppet3D:
	return puppet if puppet != null else get_parent() as Puppet3D


func _record(frame: Message) -> void:
	var character: String = _followed.statistics()["character"]
	if frame.kind != Message.Kind.CONTROLS:
		push_warning("Puppetline: %s records the mode CONTROLS only." % name)
		stop()
		return
	if _last == null:
		var scene := _followed.get_character_scene()
		_file.store_buffer(ClipFile.beginning(character, path.get_file().get_basename(), scene))
	elif _last.revision != frame.revision:
		push_warning("Puppetline: %s has changed, which ends the recording." % character)
		stop()
		return
	else:
		_time += frame.time - _last.time if Playback.continues(_last, frame) else _CUT_SECONDS
	_file.store_buffer(ClipFile.frame(character, frame, _count, _time))
	_file.flush()
	_last = frame
	_count += 1


## Save a written file as a clip, and remove it unless that fails. Return the path of the clip; empty if there are no
## frames or it cannot be saved.
static func _save(part: String, to: String) -> String:
	var clip := PuppetClip.new()
	clip.data = ClipFile.completed(FileAccess.get_file_as_bytes(part))
	var free := _free_path(to)
	if not clip.data.is_empty():
		var error := ERR_FILE_CORRUPT if clip.problem() else ResourceSaver.save(clip, free, ResourceSaver.FLAG_COMPRESS)
		if error != OK:
			push_error("Puppetline: the recording %s cannot be saved: %s." % [free, error_string(error)])
			return ""
	DirAccess.remove_absolute(part)
	if clip.data.is_empty():
		return ""
	if Engine.is_editor_hint():
		Engine.get_singleton(&"EditorInterface").get_resource_filesystem().update_file(free)
	return free


## Return a path that does not exist, by appending a number to the name.
static func _free_path(wanted: String) -> String:
	var number := 2
	var free := wanted
	while FileAccess.file_exists(free):
		free = "%s_%d.%s" % [wanted.get_basename(), number, wanted.get_extension()]
		number += 1
	return free
