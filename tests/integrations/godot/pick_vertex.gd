@tool
extends EditorPlugin
## Runs in the editor: selects the attachment of the edited scene, picks the vertex at the middle of the view by a
## click, and undoes it. The image is saved to the path in the environment variable PICTURE.

const VertexPicker := preload("res://addons/puppetline/editor/vertex_picker.gd")

var _step := 0


func _process(_delta: float) -> void:
	var scene := EditorInterface.get_edited_scene_root()
	if scene == null:
		return
	var puppet: Puppet3D = scene.get_node("Puppet")
	var attachment: PuppetAttachment3D = scene.get_node("Puppet/Attachment")
	if puppet.statistics()["sequence"] < 0:
		return
	var history := get_undo_redo().get_history_undo_redo(get_undo_redo().get_object_history_id(scene))
	_step += 1
	match _step:
		1:
			EditorInterface.set_main_screen_editor("3D")
			EditorInterface.get_selection().clear()
			EditorInterface.get_selection().add_node(attachment)
			EditorInterface.edit_node(attachment)
		20:
			var buttons := EditorInterface.get_base_control().find_children("*", "Button", true, false)
			var found := buttons.filter(func(button: Button) -> bool: return button.get_script() == VertexPicker)
			var picker: VertexPicker = found[0]
			_tell(
				{
					"before": attachment.vertex,
					"shown": picker.is_visible_in_tree(),
					"chosen": picker.attachment == attachment
				}
			)
			picker.button_pressed = true
			var camera := EditorInterface.get_editor_viewport_3d().get_camera_3d()
			var click := InputEventMouseButton.new()
			click.button_index = MOUSE_BUTTON_LEFT
			click.pressed = true
			click.position = camera.unproject_position(puppet.global_transform * Vector3(0.0, 0.6, 0.0))
			picker.take_input(camera, click, get_undo_redo())
			var from := camera.global_position
			var hit := puppet.intersect_ray(
				from, from + 2.0 * (puppet.global_transform * Vector3(0.0, 0.6, 0.0) - from)
			)
			_tell({"picked": attachment.vertex, "expected": hit["vertex"], "pressed": picker.button_pressed})
		30:
			EditorInterface.get_base_control().get_viewport().get_texture().get_image().save_png(
				OS.get_environment("PICTURE")
			)
			_tell({"distance": attachment.global_position.distance_to(puppet.global_position)})
			history.undo()
			_tell({"undone": attachment.vertex})
			get_tree().quit()


func _tell(what: Dictionary) -> void:
	print("RESULT ", JSON.stringify(what))
