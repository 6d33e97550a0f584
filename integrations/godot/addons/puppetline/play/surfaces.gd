extends RefCounted
## Mesh instances whose surfaces deform, and the materials that deform them.

const SharedScene := preload("shared_scene.gd")
const Materials := preload("materials.gd")

var instances: Array[MeshInstance3D] = []

var _shared: SharedScene
var _own: Array[Material] = []  # by surface, the original ones
var _colored: bool
var _to_file: Array[Basis] = []  # by instance: from the coordinates of its mesh
var _moving: Array[ShaderMaterial] = []
var _parameters: Dictionary = {}


func _init(shared: SharedScene, colored: bool) -> void:
	_shared = shared
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
	for material in _moving:
		material.set_shader_parameter(parameter, value)


## Set the bounding box of all instances.
func set_bounds(box: AABB) -> void:
	for instance in instances:
		instance.custom_aabb = box


## Return the deforming version of a material and of its next passes.
func _made(material: Material, to_file: Basis) -> Material:
	var made := Materials.moving(material, _colored)
	if made == null:
		return material
	var next: Material = made
	while next is ShaderMaterial:
		Materials.prepare(next, _shared)
		next.set_shader_parameter(&"puppet_mesh_to_file", to_file)
		for parameter: StringName in _parameters:
			next.set_shader_parameter(parameter, _parameters[parameter])
		_moving.append(next)
		next = next.next_pass
	return made
