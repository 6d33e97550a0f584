@tool
extends EditorPlugin
## Runs in the editor: clicks the character of the edited scene in the 3D view, and then beside it, and reports what is
## selected. The image with the gizmo is saved to the path in the environment variable PICTURE.

## Frames between two steps, in which the editor takes notice.
const PAUSE := 15

var _frames := 0


func _process(_delta: float) -> void:
	var scene := EditorInterface.get_edited_scene_root()
	if scene == null:
		return
	var puppet: Puppet3D = scene.get_node("Puppet")
	if puppet.statistics()["sequence"] < 0:
		return
	_frames += 1
	match _frames / float(PAUSE):
		1.0:
			EditorInterface.set_main_screen_editor("3D")
			EditorInterface.get_selection().clear()
		2.0:
			_tell("before")
			_click(puppet.get_surface_transform(700).origin)
		4.0:
			_tell("clicked")
			var picture := EditorInterface.get_base_control().get_viewport().get_texture().get_image()
			picture.save_png(OS.get_environment("PICTURE"))
			puppet.clip_position = 1.0
		5.0:
			_click(Vector3(0.0, -3.0, 0.0))
		7.0:
			_tell("beside")
			get_tree().quit()


func _click(place: Vector3) -> void:
	var viewport := EditorInterface.get_editor_viewport_3d()
	var container: Control = viewport.get_parent()
	for pressed: bool in [true, false]:
		var click := InputEventMouseButton.new()
		click.button_index = MOUSE_BUTTON_LEFT
		click.pressed = pressed
		click.position = container.global_position + viewport.get_camera_3d().unproject_position(place)
		click.global_position = click.position
		Input.parse_input_event(click)


func _tell(when: String) -> void:
	var selected := EditorInterface.get_selection().get_selected_nodes()
	print("RESULT ", JSON.stringify({when: selected.map(func(node: Node) -> String: return node.name)}))
