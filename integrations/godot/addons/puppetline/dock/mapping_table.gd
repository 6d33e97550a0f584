@tool
extends VBoxContainer
## A table of a mapping with one row per handle, and a figure with the joints of the selected handle.

signal handle_edited(handle: String, changes: Dictionary)
signal root_edited(joint: String, axes: String)
signal scale_edited(scale: float)

const Mapping := preload("mapping.gd")
const HandleRow := preload("handle_row.gd")
const NumberBox := preload("number_box.gd")
const AxisToggles := preload("axis_toggles.gd")
const JointFigure := preload("joint_figure.gd")
const Editor := preload("editor.gd")

const NO_ROOT := "nothing"
const DEFAULT_ROOT_AXES := "xz"

var root_joint := OptionButton.new()
var root_axes := AxisToggles.new()
var automatic := CheckBox.new()
var scale_value := NumberBox.new()
var figure := JointFigure.new()

var _grid := GridContainer.new()
var _rows: Dictionary = {}  # handle: HandleRow
var _joints := PackedStringArray()
var _group := ButtonGroup.new()
var _shown := ""  # the handle whose joints the figure shows


func _init() -> void:
	add_child(figure)
	figure.custom_minimum_size.y = 170.0 * Editor.scale()
	figure.tooltip_text = " "  # _get_tooltip is called only if a text is set
	figure.joint_pressed.connect(_press_joint)
	_grid.columns = 2
	add_child(_grid)
	_add_root()
	_add_scale()


## Return the row of a handle; null if there is none.
func row(handle: String) -> HandleRow:
	return _rows.get(handle)


## Show a mapping; null empties the table.
func show_mapping(mapping: Mapping) -> void:
	visible = mapping != null
	if mapping == null:
		return
	if mapping.handle_names() != PackedStringArray(_rows.keys()) or mapping.joints != _joints:
		_make_rows(mapping)
	for handle in mapping.handles:
		_rows[handle.name].show_handle(handle)
	root_joint.select(_joints.find(mapping.root_joint) + 1)
	root_axes.axes = mapping.root_axes
	root_axes.disabled = mapping.root_joint.is_empty()
	automatic.set_pressed_no_signal(mapping.scale == 0.0)
	scale_value.editable = mapping.scale > 0.0
	if mapping.scale > 0.0:
		scale_value.show_number(mapping.scale)
	_show_joints()


## Show the activity of the handles, from 0 to 1, in their order.
func show_activity(shares: PackedFloat32Array) -> void:
	var rows := _rows.values()
	for i in rows.size():
		rows[i].activity.share = shares[i] if i < shares.size() else 0.0


func set_disabled(disabled: bool) -> void:
	for each: HandleRow in _rows.values():
		each.set_disabled(disabled)
	figure.mouse_filter = Control.MOUSE_FILTER_IGNORE if disabled else Control.MOUSE_FILTER_STOP
	root_joint.disabled = disabled
	root_axes.disabled = disabled or root_joint.selected < 1
	automatic.disabled = disabled
	scale_value.editable = not disabled and not automatic.button_pressed


func _add_root() -> void:
	var line := HBoxContainer.new()
	line.add_child(_label("Root joint"))
	root_joint.add_item(NO_ROOT)
	root_joint.size_flags_horizontal = Control.SIZE_EXPAND_FILL
	root_joint.clip_text = true
	root_joint.tooltip_text = "The joint whose motion moves the whole character"
	root_joint.item_selected.connect(_choose_root)
	root_axes.edited.connect(func(_axes: String) -> void: _edit_root())
	line.add_child(root_joint)
	line.add_child(root_axes)
	add_child(line)


func _add_scale() -> void:
	var line := HBoxContainer.new()
	line.add_child(_label("Scale"))
	automatic.text = "automatic"
	automatic.tooltip_text = "Choose the scale so that a stretched limb moves its handle to its greatest reach"
	automatic.toggled.connect(func(on: bool) -> void: scale_edited.emit(0.0 if on else scale_value.number()))
	scale_value.size_flags_horizontal = Control.SIZE_EXPAND_FILL
	scale_value.min_value = 0.001
	scale_value.max_value = 100.0
	scale_value.allow_greater = true
	scale_value.value = 1.0
	scale_value.tooltip_text = "Metres that the character moves per metre of the performer"
	scale_value.edited.connect(scale_edited.emit)
	line.add_child(automatic)
	line.add_child(scale_value)
	add_child(line)


func _make_rows(mapping: Mapping) -> void:
	for each in _grid.get_children():
		_grid.remove_child(each)
		each.queue_free()
	_rows.clear()
	_joints = mapping.joints
	root_joint.clear()
	root_joint.add_item(NO_ROOT)
	for joint in _joints:
		root_joint.add_item(joint)
	for text: String in ["Handle", "Moved by"]:
		_grid.add_child(_label(text))
	for handle in mapping.handles:
		_add_row(handle.name)
	if _shown not in _rows and mapping.handles:
		_shown = mapping.handles[0].name
	if _shown in _rows:
		_rows[_shown].title.set_pressed_no_signal(true)


func _add_row(handle: String) -> void:
	var made := HandleRow.new(_joints, Editor.scale())
	made.title.button_group = _group
	made.title.toggled.connect(func(on: bool) -> void: _show_handle(handle, on))
	made.edited.connect(func(changes: Dictionary) -> void: _edit(handle, changes))
	_rows[handle] = made
	for cell in made.cells:
		_grid.add_child(cell)
	made.joints.icon = get_theme_icon("arrow", "OptionButton")


func _show_handle(handle: String, on: bool) -> void:
	if on:
		_shown = handle
		_show_joints()


func _show_joints() -> void:
	var shown := row(_shown)
	figure.chosen = shown.handle.joints if shown != null else PackedStringArray()


func _press_joint(joint: String) -> void:
	var shown := row(_shown)
	if shown != null and joint in _joints:
		shown.toggle_joint(joint)


func _edit(handle: String, changes: Dictionary) -> void:
	_show_joints()
	handle_edited.emit(handle, changes)


func _choose_root(_index: int) -> void:
	if root_axes.disabled:  # there was no root joint
		root_axes.axes = DEFAULT_ROOT_AXES
	_edit_root()


func _edit_root() -> void:
	var joint := root_joint.get_item_text(root_joint.selected) if root_joint.selected > 0 else ""
	root_edited.emit(joint, root_axes.axes)


func _label(text: String) -> Label:
	var label := Label.new()
	label.text = text
	return label
