@tool
extends RefCounted
## The mapping of a character as reported by the service (docs/control.md, "Editing a mapping").

const Checked := preload("checked.gd")

## Maximum number of handles that are read.
const MAX_HANDLES := 256
const MAX_JOINTS := 64

var character := ""
var handles: Array[Handle] = []
## The root joint, which moves the whole character; empty for none.
var root_joint := ""
var root_axes := ""
## Metres that the character moves per metre of the performer; 0 for the automatic scale.
var scale := 0.0
## Names of all joints.
var joints := PackedStringArray()
## Whether the mapping equals the one in the puppet file.
var saved := false


## A handle and its mapping.
class Handle:
	var name := ""
	var joints := PackedStringArray()
	var axes := ""
	var gain := 1.0


## [param result] is the result of the command `puppet`.
func _init(result: Variant) -> void:
	character = Checked.text(result, "character")
	for each in Checked.tables(result, "handles", MAX_HANDLES):
		_add_handle(each)
	var root := Checked.table(result, "root")
	root_joint = Checked.text(root, "joint")
	root_axes = Checked.text(root, "axes")
	scale = Checked.number(result, "scale", 0.0)
	joints = Checked.texts(result, "joints", MAX_JOINTS)
	saved = Checked.flag(result, "saved")


func handle_names() -> PackedStringArray:
	var names := PackedStringArray()
	for handle in handles:
		names.append(handle.name)
	return names


func _add_handle(entry: Dictionary) -> void:
	var handle := Handle.new()
	handle.name = Checked.text(entry, "name")
	handle.joints = Checked.texts(entry, "joints", MAX_JOINTS)
	handle.axes = Checked.text(entry, "axes")
	handle.gain = Checked.number(entry, "gain", 1.0)
	if handle.name not in handle_names():
		handles.append(handle)
