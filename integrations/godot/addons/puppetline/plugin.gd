@tool
extends EditorPlugin
## Adds Puppetline's dock to the editor, buttons that pick the vertex of an attachment and start a recorder, and the
## import of clips. The nodes also work without this plugin.

const DOCK := preload("dock/dock.tscn")
const VertexPicker := preload("editor/vertex_picker.gd")
const RecordButton := preload("editor/record_button.gd")
const ClipImporter := preload("editor/clip_importer.gd")

var _dock: Control
var _picker: VertexPicker
var _record: RecordButton
var _clips := ClipImporter.new()


func _enter_tree() -> void:
	_dock = DOCK.instantiate()
	add_control_to_dock(DOCK_SLOT_RIGHT_UL, _dock)
	_picker = VertexPicker.new()
	_record = RecordButton.new()
	for button: Button in [_picker, _record]:
		button.hide()
		add_control_to_container(CONTAINER_SPATIAL_EDITOR_MENU, button)
	add_import_plugin(_clips)


func _exit_tree() -> void:
	remove_import_plugin(_clips)
	remove_control_from_docks(_dock)
	_dock.free()
	for button: Button in [_picker, _record]:
		remove_control_from_container(CONTAINER_SPATIAL_EDITOR_MENU, button)
		button.free()


func _handles(object: Object) -> bool:
	return object is PuppetAttachment3D or object is PuppetRecorder


func _edit(object: Object) -> void:
	_picker.attachment = object as PuppetAttachment3D
	_record.recorder = object as PuppetRecorder


func _make_visible(visible: bool) -> void:
	_picker.visible = visible and _picker.attachment != null
	_record.visible = visible and _record.recorder != null
	if not _picker.visible:
		_picker.button_pressed = false


func _forward_3d_gui_input(camera: Camera3D, event: InputEvent) -> int:
	var used := _picker.take_input(camera, event, get_undo_redo())
	return AFTER_GUI_INPUT_STOP if used else AFTER_GUI_INPUT_PASS
