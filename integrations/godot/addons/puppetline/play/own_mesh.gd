extends RefCounted
## The meshes of a user's own character that carry ladder coordinates, which `puppetline shader-mesh` makes.

const Scene := preload("../wire/scene.gd")
const Surfaces := preload("surfaces.gd")

## What a ladder coordinate may differ from the scene's: what the file and the importer round.
const _ROUNDING := 1e-3
## Vertices of a surface that are compared with the scene.
const _SAMPLES := 64
const _NEEDED := Mesh.ARRAY_FORMAT_CUSTOM0 | Mesh.ARRAY_FORMAT_CUSTOM1 | Mesh.ARRAY_FORMAT_CUSTOM2


## Take the meshes below `source` in, so that they stand where the character does. Return what is wrong; empty if
## nothing is.
static func find(source: Node3D, scene: Scene, surfaces: Surfaces) -> String:
	for instance: MeshInstance3D in meshes_below(source):
		if _carries_ladder(instance.mesh):
			var problem := _difference(instance.mesh, scene)
			if problem:
				return problem
			var to_file := transform_within(instance, source)
			instance.transform = instance.transform * to_file.affine_inverse()
			surfaces.add(instance, _materials(instance), to_file.basis)
	if surfaces.instances.is_empty():
		return "no mesh in mesh_source carries ladder coordinates: make it with `puppetline shader-mesh`"
	return ""


## Return all mesh instances below a node, and the node itself if it is one.
static func meshes_below(source: Node) -> Array[MeshInstance3D]:
	var found: Array[MeshInstance3D] = []
	for node: Node in [source] + source.find_children("*", "MeshInstance3D", true, false):
		if node is MeshInstance3D and node.mesh != null:
			found.append(node)
	return found


static func _carries_ladder(mesh: Mesh) -> bool:
	if not mesh is ArrayMesh:
		return false
	for surface in mesh.get_surface_count():
		if mesh.surface_get_format(surface) & _NEEDED != _NEEDED:
			return false
	return mesh.get_surface_count() > 0


## Say in what a mesh differs from the one that the service moves.
static func _difference(mesh: ArrayMesh, scene: Scene) -> String:
	for surface in mesh.get_surface_count():
		var arrays := mesh.surface_get_arrays(surface)
		var ladder: PackedFloat32Array = arrays[Mesh.ARRAY_CUSTOM0]
		var numbers: PackedFloat32Array = arrays[Mesh.ARRAY_CUSTOM2]
		var count: int = arrays[Mesh.ARRAY_VERTEX].size()
		for vertex in range(0, count, maxi(1, count / _SAMPLES)):
			var number := roundi(numbers[vertex * (numbers.size() / count)])
			var same := number >= 0 and number < scene.vertex_count
			for field in mini(4, scene.field_count) if same else 0:
				var expected := scene.ladder[number * scene.field_count + field]
				same = same and absf(ladder[vertex * 4 + field] - expected) <= _ROUNDING
			if not same:
				return "mesh_source is another mesh than the service has: make it anew with `puppetline shader-mesh`"
	return ""


static func _materials(instance: MeshInstance3D) -> Array[Material]:
	var materials: Array[Material] = []
	for surface in instance.mesh.get_surface_count():
		var material := instance.get_active_material(surface)
		materials.append(material if material != null else StandardMaterial3D.new())
	instance.material_override = null
	return materials


## Return where a node stands, in the space that the node `above` itself stands in.
static func transform_within(node: Node3D, above: Node3D) -> Transform3D:
	var transform := node.transform
	var parent: Node = node
	while parent != above:
		parent = parent.get_parent()
		if parent is Node3D:
			transform = parent.transform * transform
	return transform
