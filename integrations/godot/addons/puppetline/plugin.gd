@tool
extends EditorPlugin
## Adds Puppetline's dock to the editor, a button that picks the vertex of an attachment, and the import of clips. The
## nodes also work without this plugin.

const DOCK := preload("dock/dock.tscn")
const VertexPicker := preload("editor/vertex_picker.gd")
const ClipImporter := preload("editor/clip_importer.gd")

var _dock: Control
var _picker: VertexPicker
var _clips := ClipImporter.new()


func _enter_tree() -> void:
	_dock = DOCK.instantiate()
	add_control_to_dock(DOCK_SLOT_RIGHT_UL, _dock)
	_picker = VertexPicker.new()
	_picker.hide()
	add_control_to_container(CONTAINER_SPATIAL_EDITOR_MENU, _picker)
	add_import_plugin(_clips)


func _exit_tree() -> void:
	remove_import_plugin(_clips)
	remove_control_from_docks(_dock)
	_dock.free()
	remove_control_from_container(CONTAINER_SPATIAL_EDITOR_MENU, _picker)
	_picker.free()


func _handles(object: Object) -> bool:
	return object is PuppetAttachment3D


func _edit(object: Object) -> void:
	_picker.attachment = object as PuppetAttachment3D


func _make_visible(visible: bool) -> void:
	_picker.visible = visible
	if not visible:
		_picker.button_pressed = false


func _forward_3d_gui_input(camera: Camera3D, event: InputEvent) -> int:
	var used := _picker.take_input(camera, event, get_undo_redo())
	return AFTER_GUI_INPUT_STOP if used else AFTER_GUI_INPUT_PASS
