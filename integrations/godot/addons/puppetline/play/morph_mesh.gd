extends RefCounted
## A mesh in `mesh_source` that has the morph targets of the service.

## Weight of a target while its extent is measured. It is large, so that the rest pose hardly affects the result.
const _EXAGGERATION := 1024.0

var instance: MeshInstance3D
## Override material of each surface; null if the material of the mesh is used.
var own_materials: Array[Material] = []

var _shapes := PackedInt32Array()  # by target: the index of the blend shape in this mesh
var _reaches: Array[AABB] = []  # by target: box of the displacements of its vertices
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
	for shape in _shapes:
		instance.set_blend_shape_value(shape, _EXAGGERATION)
		var box := instance.bake_mesh_from_current_blend_shape_mix().get_aabb()
		instance.set_blend_shape_value(shape, 0.0)
		var low := (box.position - _rest.end) / _EXAGGERATION
		_reaches.append(AABB(low, (box.end - _rest.position) / _EXAGGERATION - low))
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


## Compute the positions that are shown, in the coordinates of the mesh.
func positions() -> PackedVector3Array:
	var found := PackedVector3Array()
	var baked := instance.bake_mesh_from_current_blend_shape_mix()
	for surface in baked.get_surface_count():
		found.append_array(baked.surface_get_arrays(surface)[Mesh.ARRAY_VERTEX])
	return found
