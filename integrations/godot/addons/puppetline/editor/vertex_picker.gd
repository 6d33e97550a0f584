@tool
extends Button
## Button in the toolbar of the 3D view, which lets a click on the character choose the vertex of an attachment.

## The selected attachment; null for none.
var attachment: PuppetAttachment3D


func _init() -> void:
	text = "Pick Vertex"
	tooltip_text = "Click the character to attach the node there."
	toggle_mode = true
	flat = true


## Choose the vertex at a click, if the button is pressed; return whether the event was used.
func take_input(camera: Camera3D, event: InputEvent, undo_redo: EditorUndoRedoManager) -> bool:
	var click := event as InputEventMouseButton
	if not button_pressed or attachment == null or click == null or click.button_index != MOUSE_BUTTON_LEFT:
		return false
	if click.pressed:
		_pick(camera, click.position, undo_redo)
	return true


func _pick(camera: Camera3D, place: Vector2, undo_redo: EditorUndoRedoManager) -> void:
	var puppet := attachment.get_followed()
	if puppet == null:
		return
	var from := camera.project_ray_origin(place)
	var hit := puppet.intersect_ray(from, from + camera.far * camera.project_ray_normal(place))
	if hit.is_empty() or hit["vertex"] < 0:
		return
	undo_redo.create_action("Pick Vertex", UndoRedo.MERGE_DISABLE, attachment)
	undo_redo.add_do_property(attachment, &"vertex", hit["vertex"])
	undo_redo.add_undo_property(attachment, &"vertex", attachment.vertex)
	undo_redo.commit_action()
	button_pressed = false
