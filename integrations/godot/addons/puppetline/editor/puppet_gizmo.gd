@tool
extends EditorNode3DGizmoPlugin
## Shows where characters are in the editor, with the limbs and handles of selected ones. A click on a character selects
## its node.

const OwnMesh := preload("../play/own_mesh.gd")
const Scene := preload("../wire/scene.gd")
const SurfacePatch := preload("../play/surface_patch.gd")

## Time between two updates, in seconds; each takes about a millisecond.
const _INTERVAL_SECONDS := 0.1
## Size of the mark of a handle, relative to the diagonal of the character.
const _MARK := 0.01

var _puppets: Dictionary = {}  # instance number: its Places, null before they are needed
var _pause := 0.0


## The points of a character that are drawn.
class Places:
	var scene: Scene
	var handles: Array[SurfacePatch] = []
	var limbs: Array[Array] = []  # of SurfacePatch, root to tip


func _init() -> void:
	create_material("bounds", Color(1.0, 0.5, 0.5))
	create_material("limbs", Color(0.3, 0.9, 1.0), false, true)
	create_material("handles", Color(1.0, 0.8, 0.2), false, true)


func _get_gizmo_name() -> String:
	return "Puppet3D"


func _has_gizmo(node: Node3D) -> bool:
	return node is Puppet3D


## Update the gizmos of all characters, at most ten times per second.
func follow(delta: float) -> void:
	_pause -= delta
	if _pause > 0.0:
		return
	_pause = _INTERVAL_SECONDS
	for number: int in _puppets.keys():
		var puppet := instance_from_id(number) as Puppet3D
		if puppet == null:
			_puppets.erase(number)
		elif puppet.is_inside_tree():
			puppet.update_gizmos()


func _redraw(gizmo: EditorNode3DGizmo) -> void:
	gizmo.clear()
	var puppet := gizmo.get_node_3d() as Puppet3D
	if puppet.get_instance_id() not in _puppets:
		_puppets[puppet.get_instance_id()] = null
	var faces := _faces(puppet)
	if faces.is_empty():
		return
	var mesh := _mesh(faces)
	gizmo.add_lines(_edges(mesh.get_aabb()), get_material("bounds", gizmo))
	gizmo.add_collision_triangles(mesh.generate_triangle_mesh())
	if puppet in EditorInterface.get_selection().get_selected_nodes() and puppet.get_character_scene() != null:
		_draw_places(gizmo, puppet)


## Return triangles that cover the character: the boxes of its pieces, or the meshes of the preview.
func _faces(puppet: Puppet3D) -> PackedVector3Array:
	var faces := PackedVector3Array()
	var boxes := puppet.get_piece_boxes()
	var transforms := puppet.get_piece_transforms()
	for i in transforms.size():
		faces.append_array(transforms[i] * _box_faces(boxes[i]))
	if not faces.is_empty():
		return faces
	for child in puppet.get_children(true):
		for instance in OwnMesh.meshes_below(child) if child is Node3D and child.owner == null else []:
			var box: AABB = instance.mesh.get_aabb()
			faces.append_array(OwnMesh.transform_within(instance, child) * _box_faces(box))
	return faces


func _draw_places(gizmo: EditorNode3DGizmo, puppet: Puppet3D) -> void:
	var places := _places(puppet)
	var lines := PackedVector3Array()
	for limb in places.limbs:
		for i in limb.size() - 1:
			lines.append(puppet.get_patch_transform(limb[i], Transform3D.IDENTITY).origin)
			lines.append(puppet.get_patch_transform(limb[i + 1], Transform3D.IDENTITY).origin)
	if not lines.is_empty():
		gizmo.add_lines(lines, get_material("limbs", gizmo))
	var marks := PackedVector3Array()
	var half := Vector3.ONE * _MARK * places.scene.diagonal
	for handle in places.handles:
		var place := puppet.get_patch_transform(handle, Transform3D.IDENTITY).origin
		marks.append_array(_edges(AABB(place - half, 2.0 * half)))
	if not marks.is_empty():
		gizmo.add_lines(marks, get_material("handles", gizmo))


## Return the points of a character's handles and limbs, which are determined once per scene.
func _places(puppet: Puppet3D) -> Places:
	var scene := puppet.get_character_scene()
	var known: Places = _puppets[puppet.get_instance_id()]
	if known != null and known.scene == scene:
		return known
	var places := Places.new()
	places.scene = scene
	for handle: Dictionary in scene.handles:
		places.handles.append(SurfacePatch.at_vertex(scene, SurfacePatch.nearest(scene, handle["position"])))
	for limb: Dictionary in scene.limbs:
		var points: PackedVector3Array = limb["points"]
		var patches := []
		for i in points.size():
			var along := points[mini(i + 1, points.size() - 1)] - points[maxi(i - 1, 0)]
			patches.append(SurfacePatch.inside(scene, points[i], along))
		places.limbs.append(patches)
	_puppets[puppet.get_instance_id()] = places
	return places


static func _mesh(faces: PackedVector3Array) -> ArrayMesh:
	var arrays := []
	arrays.resize(Mesh.ARRAY_MAX)
	arrays[Mesh.ARRAY_VERTEX] = faces
	var mesh := ArrayMesh.new()
	mesh.add_surface_from_arrays(Mesh.PRIMITIVE_TRIANGLES, arrays)
	return mesh


static func _box_faces(box: AABB) -> PackedVector3Array:
	var shape := BoxMesh.new()
	shape.size = box.size
	return Transform3D(Basis.IDENTITY, box.get_center()) * shape.get_faces()


## Return the twelve edges of a box, two points each.
static func _edges(box: AABB) -> PackedVector3Array:
	var lines := PackedVector3Array()
	for corner in 8:
		for axis in 3:
			var other := corner | (4 >> axis)  # the corners of an AABB count x, y, z in bits from 4 to 1
			if other != corner:
				lines.append(box.get_endpoint(corner))
				lines.append(box.get_endpoint(other))
	return lines
