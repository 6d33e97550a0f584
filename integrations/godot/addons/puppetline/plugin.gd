@tool
extends EditorPlugin
## Adds Puppetline's dock to the editor. The nodes Puppet3D and PuppetOscReceiver also work without this plugin.

const DOCK := preload("dock/dock.tscn")

var _dock: Control


func _enter_tree() -> void:
	_dock = DOCK.instantiate()
	add_control_to_dock(DOCK_SLOT_RIGHT_UL, _dock)


func _exit_tree() -> void:
	remove_control_from_docks(_dock)
	_dock.free()
