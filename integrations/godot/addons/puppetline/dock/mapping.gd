@tool
extends RefCounted
## The mapping of a character in its puppet, as reported by the service (docs/control.md, "Editing a puppet").

const Checked := preload("checked.gd")

## Maximum number of handles that are read.
const MAX_HANDLES := 256
const MAX_JOINTS := 64

var character := ""
## All tables of the puppet.
var puppet: Dictionary = {}
var handles: Array[Handle] = []
## The root joint, which moves the whole character; empty for none.
var root_joint := ""
var root_axes := ""
## Metres that the character moves per metre of the performer; 0 for the automatic scale.
var scale := 0.0
## Names of all joints.
var joints := PackedStringArray()
## Whether the puppet equals the one in the file.
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
	puppet = Checked.table(result, "puppet")
	for each in Checked.tables(puppet, "handle", MAX_HANDLES):
		_add_handle(each)
	var root := Checked.table(puppet, "root")
	root_joint = Checked.text(root, "joint")
	root_axes = Checked.text(root, "axes")
	scale = Checked.number(Checked.table(puppet, "retarget"), "scale", 0.0)
	joints = Checked.texts(result, "joints", MAX_JOINTS)
	saved = Checked.flag(result, "saved")


func handle_names() -> PackedStringArray:
	var names := PackedStringArray()
	for handle in handles:
		names.append(handle.name)
	return names


## Change values of a handle, and return the tables that have changed.
func edit_handle(handle: String, changes: Dictionary) -> Dictionary:
	for each in Checked.tables(puppet, "handle", MAX_HANDLES):
		if each.get("name") == handle:
			each.merge(changes, true)
	return {"handle": puppet.get("handle")}


## Change the root joint and its axes, and return the tables that have changed. An empty joint removes the root motion.
func edit_root(joint: String, axes: String) -> Dictionary:
	var root := Checked.table(puppet, "root")
	puppet["root"] = root.merged({"joint": joint, "axes": axes}, true) if joint else null
	return {"root": puppet["root"]}


## Return the tables that change with a scale; 0 is the automatic one.
func edit_scale(metres: float) -> Dictionary:
	var chosen: Variant = metres if metres > 0.0 else "auto"
	return {"retarget": {"scale": chosen}}


func _add_handle(entry: Dictionary) -> void:
	var handle := Handle.new()
	handle.name = Checked.text(entry, "name")
	handle.joints = Checked.texts(entry, "joints", MAX_JOINTS)
	var joint := Checked.text(entry, "joint")
	if joint:
		handle.joints = PackedStringArray([joint])
	handle.axes = Checked.text(entry, "axes")
	handle.gain = Checked.number(entry, "gain", 1.0)
	if handle.name not in handle_names():
		handles.append(handle)
