extends RefCounted
## Mesh instances whose surfaces move, and the materials that move them.

const SharedScene := preload("shared_scene.gd")
const Materials := preload("materials.gd")

var instances: Array[MeshInstance3D] = []

var _shared: SharedScene
var _own: Array[Material] = []  # by surface, as they came
var _colored: bool
var _to_file: Array[Basis] = []  # by instance: from the space of its mesh
var _moving: Array[ShaderMaterial] = []
var _parameters: Dictionary = {}


func _init(shared: SharedScene, colored: bool) -> void:
	_shared = shared
	_colored = colored


## Take an instance in: it stands where the character does, and `own` are the materials of its surfaces.
func add(instance: MeshInstance3D, own: Array[Material], to_file: Basis) -> void:
	instances.append(instance)
	_own.append_array(own)
	_to_file.append(to_file)


## Put materials on all surfaces; where there is null or none for a surface, it keeps its own.
func dress(materials: Array[Material]) -> void:
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


## Set a uniform of all materials, and of those to come.
func set_parameter(parameter: StringName, value: Variant) -> void:
	_parameters[parameter] = value
	for material in _moving:
		material.set_shader_parameter(parameter, value)


## Set the box that nothing leaves.
func set_bounds(box: AABB) -> void:
	for instance in instances:
		instance.custom_aabb = box


## Return a material that moves and all that it draws after itself.
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
