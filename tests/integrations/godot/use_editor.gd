@tool
extends EditorPlugin
## Runs in the editor: presses the dock's button that adds a character to the scene, undoes and repeats it, and saves an
## image. Its settings are in environment variables, because the editor does not pass on arguments.

const Dock := preload("res://addons/puppetline/dock/dock.gd")

var _dock: Dock
var _step := 0
var _next := 0


func _process(_delta: float) -> void:
	if _dock == null:
		_find_dock()
	elif not _dock.is_visible_in_tree():
		_bring_to_front()
	elif Time.get_ticks_msec() >= _next:
		_use()


func _find_dock() -> void:
	for each in EditorInterface.get_base_control().find_children("Puppetline", "MarginContainer", true, false):
		_dock = each as Dock
	if _dock != null:
		_dock.get_node("%Address").text = OS.get_environment("ADDRESS")
		_dock.get_node("%Connect").pressed.emit()


func _bring_to_front() -> void:
	var shown: Node = _dock
	while not shown.get_parent() is TabContainer:
		shown = shown.get_parent()
	var tabs: TabContainer = shown.get_parent()
	tabs.current_tab = tabs.get_tab_idx_from_control(shown)


func _use() -> void:
	var scene := EditorInterface.get_edited_scene_root()
	if _dock.service.mapping == null or scene == null:
		return
	var history := get_undo_redo().get_object_history_id(scene)
	_step += 1  # before anything that processes frames, such as saving
	match _step:
		1:
			_tell("before")
			_dock.get_node("%AddToScene").pressed.emit()
		2:
			_tell("added")
			get_undo_redo().get_history_undo_redo(history).undo()
		3:
			_tell("undone")
			get_undo_redo().get_history_undo_redo(history).redo()
			EditorInterface.set_main_screen_editor("3D")
			_next = Time.get_ticks_msec() + 5000  # time for the character to arrive
		4:
			_tell("redone")
			var picture := EditorInterface.get_base_control().get_viewport().get_texture().get_image()
			picture.save_png(OS.get_environment("PICTURE"))
			EditorInterface.save_scene()
		5:
			get_tree().quit()


func _tell(when: String) -> void:
	var scene := EditorInterface.get_edited_scene_root()
	var nodes: Array = []
	for each in scene.find_children("*", "Puppet3D", true, false):
		nodes.append([each.name, each.owner == scene, each.character, each.host, each.port])
	var selected := EditorInterface.get_selection().get_selected_nodes()
	var told := {when: nodes, "selected": selected.map(func(node: Node) -> String: return node.name)}
	print("RESULT ", JSON.stringify(told))
