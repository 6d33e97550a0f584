@tool
extends RefCounted
## Functions of the editor that the dock uses, with fallbacks for running without an editor.

const _SECTION := "puppetline"


## Return the scale of the editor's interface, 1 on a standard screen.
static func scale() -> float:
	return EditorInterface.get_editor_scale() if Engine.is_editor_hint() else 1.0


## Return the colour of active controls.
static func accent(control: Control) -> Color:
	if control.has_theme_color("accent_color", "Editor"):
		return control.get_theme_color("accent_color", "Editor")
	return control.get_theme_color("font_pressed_color", "Button")


## Save a value for this project and user, outside of the project's files.
static func remember(key: String, value: Variant) -> void:
	if Engine.is_editor_hint():
		EditorInterface.get_editor_settings().set_project_metadata(_SECTION, key, value)


static func recall(key: String, otherwise: Variant) -> Variant:
	if not Engine.is_editor_hint():
		return otherwise
	return EditorInterface.get_editor_settings().get_project_metadata(_SECTION, key, otherwise)


## Add a node to the edited scene, below the selected node. Return an error text; empty on success.
static func add_to_scene(node: Node) -> String:
	var root := EditorInterface.get_edited_scene_root() if Engine.is_editor_hint() else null
	if root == null:
		node.free()
		return "No scene is open. Open or create a scene, and add the character again."
	var selection := EditorInterface.get_selection()
	var selected := selection.get_selected_nodes()
	var parent: Node = selected[0] if selected.size() == 1 and root.is_ancestor_of(selected[0]) else root
	var undo_redo := EditorInterface.get_editor_undo_redo()
	undo_redo.create_action("Add %s" % node.name, UndoRedo.MERGE_DISABLE, root)
	undo_redo.add_do_method(parent, "add_child", node, true)
	undo_redo.add_do_method(node, "set_owner", root)
	undo_redo.add_do_reference(node)
	undo_redo.add_undo_method(parent, "remove_child", node)
	undo_redo.commit_action()
	selection.clear()
	selection.add_node(node)
	return ""
