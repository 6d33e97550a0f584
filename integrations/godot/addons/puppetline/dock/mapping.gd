@tool
extends RefCounted
## Which joints move which handle of a character, as the service says it (docs/control.md, "Editing a mapping").

const Checked := preload("checked.gd")
const Mapping := preload("mapping.gd")

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


## Read the result of the command `puppet`.
static func read(result: Variant) -> Mapping:
	var mapping := Mapping.new()
	mapping.character = Checked.text(result, "character")
	for each in Checked.tables(result, "handles", MOST_HANDLES):
		var handle := Handle.new()
		handle.name = Checked.text(each, "name")
		handle.joints = Checked.texts(each, "joints", MOST_JOINTS)
		handle.axes = Checked.text(each, "axes")
		handle.gain = Checked.number(each, "gain", 1.0)
		if handle.name not in mapping.handle_names():
			mapping.handles.append(handle)
	var root := Checked.table(result, "root")
	mapping.root_joint = Checked.text(root, "joint")
	mapping.root_axes = Checked.text(root, "axes")
	mapping.scale = Checked.number(result, "scale", 0.0)
	mapping.joints = Checked.texts(result, "joints", MOST_JOINTS)
	mapping.saved = Checked.flag(result, "saved")
	return mapping


func handle_names() -> PackedStringArray:
	var names := PackedStringArray()
	for handle in handles:
		names.append(handle.name)
	return names
