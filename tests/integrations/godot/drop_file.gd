@tool
extends EditorPlugin
## Runs in the editor: drags figure.shader.glb from the FileSystem dock into the 3D view, undoes everything and repeats
## it, and saves the scene. It reports the nodes of the scene. The image is saved to the path in the environment
## variable PICTURE.

## Frames between two steps, in which the editor takes notice.
const PAUSE := 15

var _frames := 0
var _at := Vector2.ZERO


func _process(_delta: float) -> void:
	var scene := EditorInterface.get_edited_scene_root()
	if scene == null or EditorInterface.get_resource_filesystem().is_scanning():
		return
	var history := get_undo_redo().get_history_undo_redo(get_undo_redo().get_object_history_id(scene))
	_frames += 1
	match _frames / float(PAUSE):
		1.0:
			EditorInterface.set_main_screen_editor("3D")
			EditorInterface.get_file_system_dock().navigate_to_path("res://figure.shader.glb")
		2.0:
			_tell("before")
			_press(_item_place())
		3.0:
			_move(_at + Vector2(40.0, 0.0))
		4.0, 5.0, 6.0:
			var view: Control = EditorInterface.get_editor_viewport_3d().get_parent()
			_move(view.global_position + view.size * (0.5 + 0.01 * (_frames / PAUSE)))
		7.0:
			_release()
		9.0:
			_tell("dropped")
			history.undo()
		10.0:
			_tell("undone")
			history.undo()
		11.0:
			_tell("undone again")
			history.redo()
			history.redo()
		13.0:
			_tell("redone")
			var picture := EditorInterface.get_base_control().get_viewport().get_texture().get_image()
			picture.save_png(OS.get_environment("PICTURE"))
			EditorInterface.save_scene()
		14.0:
			get_tree().quit()


func _item_place() -> Vector2:
	for tree: Tree in EditorInterface.get_file_system_dock().find_children("*", "Tree", true, false):
		var item := tree.get_selected() if tree.is_visible_in_tree() else null
		if item != null and item.get_text(0) == "figure.shader.glb":
			return tree.global_position + tree.get_item_area_rect(item, 0).get_center() - tree.get_scroll()
	return Vector2.ZERO


func _press(place: Vector2) -> void:
	_at = place
	_button(true)


func _release() -> void:
	_button(false)


func _button(pressed: bool) -> void:
	var click := InputEventMouseButton.new()
	click.button_index = MOUSE_BUTTON_LEFT
	click.button_mask = MOUSE_BUTTON_MASK_LEFT if pressed else 0
	click.pressed = pressed
	click.position = _at
	click.global_position = _at
	Input.parse_input_event(click)


func _move(to: Vector2) -> void:
	var motion := InputEventMouseMotion.new()
	motion.button_mask = MOUSE_BUTTON_MASK_LEFT
	motion.relative = to - _at
	_at = to
	motion.position = _at
	motion.global_position = _at
	Input.parse_input_event(motion)


func _tell(when: String) -> void:
	var nodes: Array = []
	for node in EditorInterface.get_edited_scene_root().get_children():
		var puppet := node as Puppet3D
		nodes.append([node.name, puppet.character if puppet != null else null])
	print("RESULT ", JSON.stringify({when: nodes}))
