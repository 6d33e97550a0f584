extends RefCounted
## Functions for the meshes in `mesh_source` that have isoline coordinates, as written by `puppetline shader-mesh`.

const Scene := preload("../wire/scene.gd")
const Surfaces := preload("surfaces.gd")

## Maximum difference of an isoline coordinate from the scene's, caused by rounding in the file and the importer.
const _TOLERANCE := 1e-3
## Approximate number of vertices per surface that are compared with the scene.
const _SAMPLE_COUNT := 64
const _REQUIRED_FORMAT := Mesh.ARRAY_FORMAT_CUSTOM0 | Mesh.ARRAY_FORMAT_CUSTOM1 | Mesh.ARRAY_FORMAT_CUSTOM2


## Add the meshes below [param source] to [param surfaces], and align them with the character. Return a description of
## the problem; empty if there is none.
static func find(source: Node3D, scene: Scene, surfaces: Surfaces) -> String:
	for instance: MeshInstance3D in meshes_below(source):
		if has_isoline_coordinates(instance.mesh):
			var problem := _difference(instance.mesh, scene)
			if problem:
				return problem
			var to_file := transform_within(instance, source)
			instance.transform = instance.transform * to_file.affine_inverse()
			surfaces.add(instance, _materials(instance), to_file.basis)
	if surfaces.instances.is_empty():
		return "no mesh in mesh_source has isoline coordinates; make it with `puppetline shader-mesh`"
	return ""


## Return a new instance of a scene; null without one, or if it is no scene of 3D nodes.
static func instance_of(scene: PackedScene) -> Node3D:
	var own := scene.instantiate() if scene != null else null
	if own != null and not own is Node3D:
		push_warning("Puppetline: %s is not a scene of 3D nodes. Import a .glb." % scene.resource_path)
		own.free()
		return null
	return own


## Return all mesh instances below a node, including the node itself.
static func meshes_below(source: Node) -> Array[MeshInstance3D]:
	var found: Array[MeshInstance3D] = []
	for node: Node in [source] + source.find_children("*", "MeshInstance3D", true, false):
		if node is MeshInstance3D and node.mesh != null:
			found.append(node)
	return found


## Return whether all surfaces of a mesh have isoline coordinates.
static func has_isoline_coordinates(mesh: Mesh) -> bool:
	if not mesh is ArrayMesh:
		return false
	for surface in mesh.get_surface_count():
		if mesh.surface_get_format(surface) & _REQUIRED_FORMAT != _REQUIRED_FORMAT:
			return false
	return mesh.get_surface_count() > 0


## Return how a mesh differs from the service's mesh; empty if it does not.
static func _difference(mesh: ArrayMesh, scene: Scene) -> String:
	for surface in mesh.get_surface_count():
		var arrays := mesh.surface_get_arrays(surface)
		var coordinates: PackedFloat32Array = arrays[Mesh.ARRAY_CUSTOM0]
		var numbers: PackedFloat32Array = arrays[Mesh.ARRAY_CUSTOM2]
		var count: int = arrays[Mesh.ARRAY_VERTEX].size()
		for vertex in range(0, count, maxi(1, count / _SAMPLE_COUNT)):
			var number := roundi(numbers[vertex * (numbers.size() / count)])
			var same := number >= 0 and number < scene.vertex_count
			for field in mini(4, scene.field_count) if same else 0:
				var expected := scene.isoline_coordinates[number * scene.field_count + field]
				same = same and absf(coordinates[vertex * 4 + field] - expected) <= _TOLERANCE
			if not same:
				return "mesh_source is not the mesh that the service has; run `puppetline shader-mesh` again"
	return ""


static func _materials(instance: MeshInstance3D) -> Array[Material]:
	var materials: Array[Material] = []
	for surface in instance.mesh.get_surface_count():
		var material := instance.get_active_material(surface)
		materials.append(material if material != null else StandardMaterial3D.new())
	instance.material_override = null
	return materials


## Return the transform of a node relative to the parent of its ancestor [param above].
static func transform_within(node: Node3D, above: Node3D) -> Transform3D:
	var transform := node.transform
	var parent: Node = node
	while parent != above:
		parent = parent.get_parent()
		if parent is Node3D:
			transform = parent.transform * transform
	return transform
