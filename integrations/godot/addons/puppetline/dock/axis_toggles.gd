@tool
extends HBoxContainer
## Three toggle buttons for axes of the performer's motion: x sideways, y up, z forwards.

signal edited(axes: String)

const TOOLTIPS := {"x": "Sideways", "y": "Up and down", "z": "Forwards and back"}

## The selected axes, a subset of "xyz" in this order.
var axes := "":
	set(value):
		axes = value
		for axis: String in _buttons:
			_buttons[axis].set_pressed_no_signal(axis in axes)

var disabled := false:
	set(value):
		disabled = value
		for axis: String in _buttons:
			_buttons[axis].disabled = value

var _buttons: Dictionary = {}


func _init() -> void:
	add_theme_constant_override("separation", 0)
	for axis: String in TOOLTIPS:
		var button := Button.new()
		button.text = axis.to_upper()
		button.toggle_mode = true
		button.tooltip_text = TOOLTIPS[axis]
		button.toggled.connect(func(_on: bool) -> void: _edit())
		_buttons[axis] = button
		add_child(button)


## Return the button of an axis, for example "x".
func button(axis: String) -> Button:
	return _buttons[axis]


func _edit() -> void:
	axes = "".join(_buttons.keys().filter(func(axis: String) -> bool: return _buttons[axis].button_pressed))
	edited.emit(axes)
