extends RefCounted
## A mesh of the user's own character that has the morph targets of the service.

## By which targets are exaggerated to measure them, so that what they start from does not count.
const _EXAGGERATION := 1024.0

var instance: MeshInstance3D
## By surface: what it wears by itself, or null for what is in the mesh.
var own_materials: Array[Material] = []

var _shapes := PackedInt32Array()  # by target: the number of the blend shape here
var _reaches: Array[AABB] = []  # by target: how far it moves anything, at most, to either side
var _rest := AABB()


## Tell whether the mesh has all of the targets, and remember where they are.
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


## Set how far each target is in, and the box that nothing leaves then.
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


## Compute the positions that are shown just now, in the mesh's own space.
func positions() -> PackedVector3Array:
	var found := PackedVector3Array()
	var baked := instance.bake_mesh_from_current_blend_shape_mix()
	for surface in baked.get_surface_count():
		found.append_array(baked.surface_get_arrays(surface)[Mesh.ARRAY_VERTEX])
	return found
