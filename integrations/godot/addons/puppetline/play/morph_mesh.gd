extends RefCounted
## A mesh in `mesh_source` that has the morph targets of the service.


## A vertex of the mesh.
class Vertex:
	## In the coordinates of the node that shows the character.
	var position: Vector3
	var mesh: RefCounted
	var surface: int
	var index: int
	var to_node: Basis

	## Return the displacement by each target, in the coordinates of the node.
	func displacements() -> PackedVector3Array:
		return Transform3D(to_node, Vector3.ZERO) * (mesh.displacements(surface, index) as PackedVector3Array)


var instance: MeshInstance3D
## Override material of each surface; null if the material of the mesh is used.
var own_materials: Array[Material] = []

var _shapes := PackedInt32Array()  # by target: the index of the blend shape in this mesh
var _reaches: Array[AABB] = []  # by target: box of the displacements of its vertices
var _displacements: Array[Array] = []  # by surface and target: a PackedVector3Array, by vertex
var _rest := AABB()


## Find the targets in the mesh; return false if any is missing.
func find(names: Array) -> bool:
	for name: String in names:
		var shape := instance.find_blend_shape_by_name(name)
		if shape < 0:
			return false
		_shapes.append(shape)
	for surface in instance.mesh.get_surface_count():
		own_materials.append(instance.get_surface_override_material(surface))
	_rest = instance.mesh.get_aabb()
	_displacements = _read_displacements()
	for target in _shapes.size():
		_reaches.append(_reach_of(target))
	return true


## Set the weights of all targets, and a bounding box for them.
func set_weights(weights: PackedFloat32Array) -> void:
	var low := _rest.position
	var high := _rest.end
	for i in weights.size():
		instance.set_blend_shape_value(_shapes[i], weights[i])
		var reach := AABB(_reaches[i].position * weights[i], _reaches[i].size * weights[i]).abs()
		low += reach.position
		high += reach.end
	var box := AABB(low, high - low)
	instance.custom_aabb = box if box.is_finite() else _rest


## Return the vertices in a box, both in the coordinates that [param to_node] transforms to.
func vertices_in(box: AABB, to_node: Transform3D) -> Array[Vertex]:
	var found: Array[Vertex] = []
	for surface in instance.mesh.get_surface_count():
		var positions: PackedVector3Array = to_node * instance.mesh.surface_get_arrays(surface)[Mesh.ARRAY_VERTEX]
		for index in positions.size():
			if not box.has_point(positions[index]):
				continue
			var vertex := Vertex.new()
			vertex.position = positions[index]
			vertex.mesh = self
			vertex.surface = surface
			vertex.index = index
			vertex.to_node = to_node.basis
			found.append(vertex)
	return found


## Return the displacement of a vertex by each target.
func displacements(surface: int, index: int) -> PackedVector3Array:
	var found := PackedVector3Array()
	for of_target: PackedVector3Array in _displacements[surface]:
		found.append(of_target[index])
	return found


## Compute the positions that are shown, in the coordinates of the mesh.
func positions() -> PackedVector3Array:
	var found := PackedVector3Array()
	var baked := instance.bake_mesh_from_current_blend_shape_mix()
	for surface in baked.get_surface_count():
		found.append_array(baked.surface_get_arrays(surface)[Mesh.ARRAY_VERTEX])
	return found


## Read the displacements by all targets, once: whenever one is asked for, the engine decodes all of them.
func _read_displacements() -> Array[Array]:
	var mesh: ArrayMesh = instance.mesh
	var found: Array[Array] = []
	for surface in mesh.get_surface_count():
		var rest: PackedVector3Array = mesh.surface_get_arrays(surface)[Mesh.ARRAY_VERTEX]
		var shapes := mesh.surface_get_blend_shape_arrays(surface)
		var of_targets := []
		for shape in _shapes:
			var moved: PackedVector3Array = shapes[shape][Mesh.ARRAY_VERTEX]
			if mesh.blend_shape_mode == Mesh.BLEND_SHAPE_MODE_NORMALIZED:  # a shape has positions, not displacements
				for i in moved.size():
					moved[i] -= rest[i]
			of_targets.append(moved)
		found.append(of_targets)
	return found


## Return the box of the displacements by a target.
func _reach_of(target: int) -> AABB:
	var low := Vector3.INF
	var high := -Vector3.INF
	for of_targets in _displacements:
		for displacement: Vector3 in of_targets[target]:
			low = low.min(displacement)
			high = high.max(displacement)
	return AABB(low, high - low)
