extends RefCounted
## Mesh instances whose surfaces deform, and the materials that deform them.

const SceneResources := preload("scene_resources.gd")
const Materials := preload("materials.gd")
const MaterialCopy := preload("material_copy.gd")

var instances: Array[MeshInstance3D] = []

var _resources: SceneResources
var _own: Array[Material] = []  # by surface, the original ones
var _colored: bool
var _to_file: Array[Basis] = []  # by instance: from the coordinates of its mesh
var _moving: Array[MaterialCopy] = []
var _next_followed := 0
var _parameters: Dictionary = {}


func _init(resources: SceneResources, colored: bool) -> void:
	_resources = resources
	_colored = colored


## Add an instance that is aligned with the character. [param own] are the original materials of its surfaces.
func add(instance: MeshInstance3D, own: Array[Material], to_file: Basis) -> void:
	instances.append(instance)
	_own.append_array(own)
	_to_file.append(to_file)


## Set the materials of all surfaces. A surface with null or without a material keeps its original one.
func set_materials(materials: Array[Material]) -> void:
	_moving.clear()
	var surface := 0
	for i in instances.size():
		var made: Dictionary = {}
		for j in instances[i].mesh.get_surface_count():
			var given := materials[surface] if surface < materials.size() else null
			var material := given if given != null else _own[surface]
			if material not in made:
				made[material] = _made(material, _to_file[i])
			instances[i].set_surface_override_material(j, made[material])
			surface += 1


## Set a uniform of all materials, including those that are set later.
func set_parameter(parameter: StringName, value: Variant) -> void:
	_parameters[parameter] = value
	for copy in _moving:
		copy.material.set_shader_parameter(parameter, value)


## Pass on the changes of one material to its copy, the next one at each call, which keeps the cost small.
func follow_materials() -> void:
	if not _moving.is_empty():
		_next_followed = (_next_followed + 1) % _moving.size()
		_moving[_next_followed].follow()


## Set the bounding box of all instances.
func set_bounds(box: AABB) -> void:
	for instance in instances:
		instance.custom_aabb = box


## Return the deforming version of a material.
func _made(material: Material, to_file: Basis) -> Material:
	var copies := Materials.moving(material, _colored)
	for copy in copies:
		Materials.prepare(copy.material, _resources)
		copy.material.set_shader_parameter(&"puppet_mesh_to_file", to_file)
		for parameter: StringName in _parameters:
			copy.material.set_shader_parameter(parameter, _parameters[parameter])
	_moving.append_array(copies)
	return material if copies.is_empty() else copies[0].material
