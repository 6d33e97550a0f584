@tool
extends RefCounted
## A row of the mapping table: a handle, the joints whose mean motion it follows, the axes and the gain.

signal edited(changes: Dictionary)

const ActivityBar := preload("activity_bar.gd")
const AxisToggles := preload("axis_toggles.gd")
const NumberBox := preload("number_box.gd")
const Mapping := preload("mapping.gd")

const MAX_GAIN := 10.0

## The handle that this row shows.
var handle: Mapping.Handle
## The cells from left to right: the handle, and its joints, axes and gain.
var cells: Array[Control] = [VBoxContainer.new(), VBoxContainer.new()]
## Pressed while the figure shows the handle's joints.
var title := Button.new()
var activity := ActivityBar.new()
var joints := MenuButton.new()
var axes := AxisToggles.new()
var gain := NumberBox.new()


func _init(all_joints: PackedStringArray, scale: float) -> void:
	_lay_out(scale)
	var menu := joints.get_popup()
	menu.hide_on_checkable_item_selection = false
	for joint in all_joints:
		menu.add_check_item(joint)
	menu.index_pressed.connect(func(index: int) -> void: toggle_joint(menu.get_item_text(index)))
	gain.prefix = "×"
	gain.min_value = -MAX_GAIN
	gain.max_value = MAX_GAIN
	gain.allow_greater = true
	gain.allow_lesser = true
	gain.tooltip_text = "How far the handle moves relative to its joints; negative values reverse the direction"
	axes.edited.connect(func(chosen: String) -> void: edited.emit({"axes": chosen}))
	gain.edited.connect(func(number: float) -> void: edited.emit({"gain": number}))


## Show the values of a handle.
func show_handle(shown: Mapping.Handle) -> void:
	handle = shown
	title.text = handle.name
	title.tooltip_text = handle.name
	joints.text = ", ".join(handle.joints) if handle.joints else "none"
	joints.tooltip_text = "Moved by %s" % ", ".join(handle.joints) if handle.joints else "No joint moves this handle"
	var menu := joints.get_popup()
	for i in menu.item_count:
		menu.set_item_checked(i, menu.get_item_text(i) in handle.joints)
	if axes.axes != handle.axes:
		axes.axes = handle.axes
	gain.show_number(handle.gain)


## Add a joint to the handle's joints, or remove it.
func toggle_joint(joint: String) -> void:
	var chosen := handle.joints.duplicate()
	if joint in chosen:
		chosen.remove_at(chosen.find(joint))
	else:
		chosen.append(joint)
	handle.joints = chosen
	show_handle(handle)
	var several: Variant = Array(chosen) if chosen.size() > 1 else null
	edited.emit({"joint": chosen[0] if chosen.size() == 1 else null, "joints": several})


func set_disabled(disabled: bool) -> void:
	joints.disabled = disabled
	axes.disabled = disabled
	gain.editable = not disabled


func _lay_out(scale: float) -> void:
	for cell in cells:
		cell.size_flags_horizontal = Control.SIZE_EXPAND_FILL
	for button: Button in [title, joints]:
		button.alignment = HORIZONTAL_ALIGNMENT_LEFT
		button.text_overrun_behavior = TextServer.OVERRUN_TRIM_ELLIPSIS
		button.clip_text = true
	title.toggle_mode = true
	title.size_flags_vertical = Control.SIZE_EXPAND_FILL
	joints.flat = false
	joints.icon_alignment = HORIZONTAL_ALIGNMENT_RIGHT
	activity.custom_minimum_size.y = 3.0 * scale
	activity.tooltip_text = "Current motion of the handle"
	gain.size_flags_horizontal = Control.SIZE_EXPAND_FILL
	cells[0].add_child(title)
	cells[0].add_child(activity)
	cells[1].add_child(joints)
	var line := HBoxContainer.new()
	line.add_child(axes)
	line.add_child(gain)
	cells[1].add_child(line)
