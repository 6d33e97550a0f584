@tool
extends EditorPlugin
## Runs in the editor: selects the recorder of the edited scene, and clicks *Record Clip* to record a second. It reports
## the number of each frame, and at the end what was saved. The image during the recording is saved to the path in the
## environment variable PICTURE.

## Frames between two steps, in which the editor takes notice.
const PAUSE := 15

var _frames := 0
var _steps: Array[Callable] = [_select, _tell_visible, _click, _photograph, _click, _tell_hidden, _quit]
var _puppet: Puppet3D
var _recorder: PuppetRecorder


func _process(_delta: float) -> void:
	var scene := EditorInterface.get_edited_scene_root()
	if scene == null or EditorInterface.get_resource_filesystem().is_scanning():
		return
	_puppet = scene.get_node("Puppet")
	_recorder = _puppet.get_node("Recorder")
	if _puppet.statistics()["sequence"] < 0 or (_recorder.is_recording() and _recorder.get_duration() < 1.0):
		return
	_frames += 1
	if _frames % PAUSE == 0:
		_steps.pop_front().call()


func _select() -> void:
	EditorInterface.set_main_screen_editor("3D")
	EditorInterface.edit_node(_recorder)
	_puppet.frame_received.connect(_on_frame)
	_recorder.saved.connect(_on_saved)


func _click() -> void:
	for pressed: bool in [true, false]:
		var click := InputEventMouseButton.new()
		click.button_index = MOUSE_BUTTON_LEFT
		click.button_mask = MOUSE_BUTTON_MASK_LEFT if pressed else 0
		click.pressed = pressed
		click.position = _button().get_global_rect().get_center()
		click.global_position = click.position
		Input.parse_input_event(click)


func _photograph() -> void:
	var is_timed := _button().text == "Record Clip (%.1f s)" % _recorder.get_duration()
	_tell({"pressed": _button().button_pressed, "timed": is_timed})
	var picture := EditorInterface.get_base_control().get_viewport().get_texture().get_image()
	picture.save_png(OS.get_environment("PICTURE"))


func _tell_visible() -> void:
	_tell({"visible": _button().is_visible_in_tree(), "text": _button().text})


func _tell_hidden() -> void:
	_tell({"pressed": _button().button_pressed, "text": _button().text})
	EditorInterface.edit_node(_puppet)


func _quit() -> void:
	_tell({"visible": _button().is_visible_in_tree()})
	get_tree().quit()


func _on_frame(frame: RefCounted) -> void:
	if _recorder.is_recording():
		_tell({"frame": frame.sequence})


func _on_saved(to: String) -> void:
	var clip: PuppetClip = load(to)
	var type := EditorInterface.get_resource_filesystem().get_file_type(to)
	_tell({"moments": range(clip.frame_count()).map(clip.frame_position)})
	_tell({"saved": to, "problem": clip.problem(), "listed": type})


func _button() -> Button:
	for button: Button in EditorInterface.get_base_control().find_children("*", "Button", true, false):
		if button.text.begins_with("Record Clip"):
			return button
	return null


func _tell(what: Dictionary) -> void:
	print("RESULT ", JSON.stringify(what, "", false, true))
