extends "teller.gd"
## Operates the dock by the commands in a file, and reports its contents on each change.
##
## COMMANDS: a file to which lines of JSON are appended, for example ["press", "Calibrate"]; see the functions.

const Dock := preload("res://addons/puppetline/dock/dock.gd")

var _dock: Dock
var _done := 0
var _told := ""
var _moved: Array[String] = []  # handles that have moved since the last command


func start() -> void:
	_dock = (load("res://addons/puppetline/dock/dock.tscn") as PackedScene).instantiate()
	_dock.size = Vector2(300.0, 900.0)
	_dock.hide()  # it has no address yet
	root.add_child(_dock)


func step(_delta: float) -> bool:
	var lines := FileAccess.get_file_as_string(arguments()[0]).split("\n")
	while _done < lines.size() - 1:
		var command: Array = JSON.parse_string(lines[_done])
		callv(command[0], command.slice(1))
		_done += 1
		_moved.clear()
	var shown := _shown()
	if JSON.stringify(shown) != _told:
		_told = JSON.stringify(shown)
		tell(shown)
	if is_over():
		_dock.free()
	return is_over()


func press(button: String) -> void:
	if not _part(button).disabled:
		_part(button).pressed.emit()


func toggle(button: String, on: bool) -> void:
	_part(button).button_pressed = on


func type(field: String, text: String) -> void:
	_part(field).text = text
	if _dock.visible:
		_part(field).text_submitted.emit(text)


## Choose a service from the menu of those that were found on the network.
func find(host: String, port: int) -> void:
	var characters := PackedStringArray(["dog"])
	var found := {"name": "found", "host": host, "port": port, "control": port + 1}
	_dock._discovery.services = [found.merged({"characters": characters, "mechanism": "PLAIN"})] as Array[Dictionary]
	_dock._discovery.changed.emit()
	_part("Found").get_popup().index_pressed.emit(0)


func select(button: String, item: String) -> void:
	_select(_part(button), item)


func gain(handle: String, value: float) -> void:
	_table().row(handle).gain.value = value


func axis(handle: String, letter: String, on: bool) -> void:
	_table().row(handle).axes.button(letter).button_pressed = on


func joint(handle: String, name: String) -> void:
	var menu: PopupMenu = _table().row(handle).joints.get_popup()
	for i in menu.item_count:
		if menu.get_item_text(i) == name:
			menu.index_pressed.emit(i)


## Click on the figure while it shows a handle.
func point(handle: String, name: String) -> void:
	_table().row(handle).title.button_pressed = true
	var click := InputEventMouseButton.new()
	click.button_index = MOUSE_BUTTON_LEFT
	click.pressed = true
	click.position = _table().figure.joint_position(name) + Vector2(1.0, -1.0)
	_table().figure._gui_input(click)


func carry(name: String) -> void:
	_select(_table().root_joint, name)


func scale(value: float) -> void:
	_table().automatic.button_pressed = value == 0.0
	if value > 0.0:
		_table().scale_value.value = value


func hide() -> void:
	_dock.hide()


func show() -> void:
	_dock.show()


func _select(button: OptionButton, item: String) -> void:
	for i in button.item_count:
		if button.get_item_text(i) == item:
			button.select(i)
			button.item_selected.emit(i)


func _shown() -> Dictionary:
	var table := _table()
	var rows := {}
	for handle: String in table._rows:
		var row := table.row(handle)
		if row.activity.share > 0.05 and handle not in _moved:
			_moved.append(handle)
		rows[handle] = {
			"joints": row.joints.text,
			"axes": row.axes.axes,
			"gain": row.gain.number(),
			"editable": row.gain.editable,
		}
	return {
		"done": _done,
		"connection": _part("Connection").text,
		"token": _part("Token").text,
		"characters": _items(_part("Character")),
		"character": _part("Character").text,
		"facts": _part("Facts").text if _part("Facts").visible else "",
		"performers": _items(_part("Performer")),
		"performer": _part("Performer").text,
		"mirror": _part("Mirror").button_pressed,
		"recording": _part("Record").button_pressed,
		"can":
		["Calibrate", "Mirror", "Record", "AddToScene", "Save", "Revert"].filter(
			func(button: String) -> bool: return not _part(button).disabled
		),
		"rows": rows if table.visible else {},
		"moved": _moved,
		"figure": Array(table.figure.chosen),
		"root": [table.root_joint.text, table.root_axes.axes],
		"scale": 0.0 if table.automatic.button_pressed else table.scale_value.number(),
		"trouble": _part("TroubleText").text if _part("Trouble").visible else "",
	}


func _items(button: OptionButton) -> Array:
	return range(button.item_count).map(func(i: int) -> String: return button.get_item_text(i))


func _part(name: String) -> Variant:
	return _dock.get_node("%" + name)


func _table() -> Dock.MappingTable:
	return _dock._mapping
