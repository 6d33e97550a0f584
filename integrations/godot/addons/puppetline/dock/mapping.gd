@tool
extends RefCounted
## Which joints move which handle of a character, as the service says it (docs/control.md, "Editing a mapping").

const Checked := preload("checked.gd")

## Rows that a dock has room for.
const MOST_HANDLES := 256
const MOST_JOINTS := 64

var character := ""
var handles: Array[Handle] = []
## The joint that carries the whole character; empty for none.
var root_joint := ""
var root_axes := ""
## The character's metres for one of the performer's; 0 for one that is found out.
var scale := 0.0
## All joints that there are.
var joints := PackedStringArray()
## Whether the puppet file says the same.
var saved := false


## A point on the surface, and what moves it.
class Handle:
	var name := ""
	var joints := PackedStringArray()
	var axes := ""
	var gain := 1.0


## [param result] is that of the command `puppet`.
func _init(result: Variant) -> void:
	character = Checked.text(result, "character")
	for each in Checked.tables(result, "handles", MOST_HANDLES):
		_add_handle(each)
	var root := Checked.table(result, "root")
	root_joint = Checked.text(root, "joint")
	root_axes = Checked.text(root, "axes")
	scale = Checked.number(result, "scale", 0.0)
	joints = Checked.texts(result, "joints", MOST_JOINTS)
	saved = Checked.flag(result, "saved")


func handle_names() -> PackedStringArray:
	var names := PackedStringArray()
	for handle in handles:
		names.append(handle.name)
	return names


func _add_handle(said: Dictionary) -> void:
	var handle := Handle.new()
	handle.name = Checked.text(said, "name")
	handle.joints = Checked.texts(said, "joints", MOST_JOINTS)
	handle.axes = Checked.text(said, "axes")
	handle.gain = Checked.number(said, "gain", 1.0)
	if handle.name not in handle_names():
		handles.append(handle)
