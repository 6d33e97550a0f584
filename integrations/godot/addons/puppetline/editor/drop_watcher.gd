@tool
extends RefCounted
## Replaces a file of `puppetline shader-mesh` that was dropped into the edited scene by a [Puppet3D] that shows it.
##
## The editor does not notify plugins of a drop, so this class watches for new nodes. The first undo restores the file's
## own nodes, which are not replaced again.

const OwnMesh := preload("../play/own_mesh.gd")
const Puppet3DNode := preload("../puppet_3d.gd")

## Part of a file's name after the name of the character.
const _SUFFIX := ".shader"

var _undo_redo: EditorUndoRedoManager
var _seen: Dictionary = {}  # instance numbers of nodes that have been considered, and are not considered again
var _root: Node
var _version := -1  # of the history of the edited scene


func _init(undo_redo: EditorUndoRedoManager) -> void:
	_undo_redo = undo_redo


## Remember the state of the edited scene, once per frame: a node is new only if an action has added it since.
func follow() -> void:
	_root = EditorInterface.get_edited_scene_root()
	_version = _version_of(_root)


## Consider a node that has been added to the tree.
func notice(node: Node) -> void:
	if node is Node3D and node.scene_file_path and node.get_instance_id() not in _seen:
		_replace.call_deferred(node.get_instance_id())


func _replace(number: int) -> void:
	var node := instance_from_id(number) as Node3D
	var root := EditorInterface.get_edited_scene_root()
	if node == null or root == null or number in _seen:
		return
	_seen[number] = true
	var is_new := root == _root and _version_of(root) != _version and root.is_ancestor_of(node) and node.owner == root
	if not is_new or node.get_parent() is Puppet3DNode or not _is_shader_mesh(node):
		return
	var puppet := _puppet_like(node)
	var parent := node.get_parent()
	var place := node.get_index()
	_undo_redo.create_action("Show %s as Puppet3D" % node.name, UndoRedo.MERGE_DISABLE, root)
	_undo_redo.add_do_method(parent, "remove_child", node)
	_undo_redo.add_undo_method(parent, "remove_child", puppet)
	for method: Array in [["add_do_method", puppet], ["add_undo_method", node]]:
		_undo_redo.call(method[0], parent, "add_child", method[1], true)
		_undo_redo.call(method[0], parent, "move_child", method[1], place)
		_undo_redo.call(method[0], method[1], "set_owner", root)
	_undo_redo.add_do_reference(puppet)
	_undo_redo.add_undo_reference(node)
	_undo_redo.commit_action()
	EditorInterface.get_selection().clear()
	EditorInterface.get_selection().add_node(puppet)


func _puppet_like(node: Node3D) -> Puppet3D:
	var puppet: Puppet3D = Puppet3DNode.new()
	puppet.name = node.name
	puppet.transform = node.transform
	puppet.mesh_source = load(node.scene_file_path)
	var stem := node.scene_file_path.get_file().get_basename()
	puppet.character = stem.trim_suffix(_SUFFIX) if stem.ends_with(_SUFFIX) else ""
	return puppet


func _version_of(root: Node) -> int:
	if root == null:
		return -1
	return _undo_redo.get_history_undo_redo(_undo_redo.get_object_history_id(root)).get_version()


static func _is_shader_mesh(node: Node3D) -> bool:
	return OwnMesh.meshes_below(node).any(
		func(instance: MeshInstance3D) -> bool: return OwnMesh.has_isoline_coordinates(instance.mesh)
	)
