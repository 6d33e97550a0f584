extends "body.gd"
## A character moved by morph targets, those of a .glb that `puppetline bake` has made.

const OwnMesh := preload("own_mesh.gd")

## By which targets are exaggerated to measure them, so that what they start from does not count.
const _EXAGGERATION := 1024.0


## One mesh that has targets.
class Target:
	var instance: MeshInstance3D
	## By target of the scene, the number of the blend shape here.
	var shapes := PackedInt32Array()
	var rest := AABB()
	## By target: how far it moves anything, at most, to either side.
	var reaches: Array[AABB] = []


var _source: Node3D
var _targets: Array[Target] = []
var _count := 0
var _earlier: Message  # whose weights are in _from
var _later: Message
var _from := PackedFloat32Array()
var _to := PackedFloat32Array()


## `source` is the user's own character, a child of this node, or null.
func _init(of: SharedScene, source: Node3D) -> void:
	shared = of
	_source = source
	if not shared.scene.morphs is Array or shared.scene.morphs.is_empty():
		problem = "the service has no morph targets of this character: give it what `puppetline bake` made (--morphs)"
		return
	_count = shared.scene.morphs.size()
	if source == null:
		problem = "there is no mesh_source: it wants the .glb that `puppetline bake` made"
		return
	add_child(source)
	for instance in OwnMesh.meshes_below(source):
		_add(instance)
	if _targets.is_empty():
		problem = "no mesh in mesh_source has the targets of the service, %s: bake anew" % ", ".join(_names())


func word() -> String:
	return "morphs"


func frame_size() -> int:
	return 4 * (1 + _count)


func dress(materials: Array[Material]) -> void:
	var surface := 0
	for target in _targets:
		for i in target.instance.mesh.get_surface_count():
			var material := materials[surface] if surface < materials.size() else null
			target.instance.set_surface_override_material(i, material)
			surface += 1


func show_frames(earlier: Message, later: Message, share: float) -> void:
	if _earlier != earlier or _later != later:
		_earlier = earlier
		_later = later
		_from = earlier.payload.to_float32_array()
		_to = later.payload.to_float32_array()
	if follow_root:
		_source.position = earlier.root.lerp(later.root, share)
	for target in _targets:
		var low := Vector3.ZERO
		var high := Vector3.ZERO
		for i in _count:
			var weight := lerpf(_from[1 + i], _to[1 + i], share)  # before them stands the residual
			target.instance.set_blend_shape_value(target.shapes[i], weight)
			var reach := AABB(target.reaches[i].position * weight, target.reaches[i].size * weight).abs()
			low += reach.position
			high += reach.end
		var box := AABB(target.rest.position + low, target.rest.size + high - low)
		target.instance.custom_aabb = box if box.is_finite() else target.rest


## The order is that of the meshes and their vertices as Godot's importer has them, which may be another than the
## scene's.
func evaluate() -> PackedVector3Array:
	var positions := PackedVector3Array()
	for target in _targets:
		var to_body := OwnMesh.transform_within(target.instance, _source)
		var baked := target.instance.bake_mesh_from_current_blend_shape_mix()
		for surface in baked.get_surface_count():
			positions.append_array(
				to_body * (baked.surface_get_arrays(surface)[Mesh.ARRAY_VERTEX] as PackedVector3Array)
			)
	return positions


func _names() -> Array:
	return shared.scene.morphs


## Take a mesh in that has all of the targets.
func _add(instance: MeshInstance3D) -> void:
	var target := Target.new()
	target.instance = instance
	for name: String in _names():
		var shape := instance.find_blend_shape_by_name(name)
		if shape < 0:
			return
		target.shapes.append(shape)
	target.rest = instance.mesh.get_aabb()
	for shape in target.shapes:
		instance.set_blend_shape_value(shape, _EXAGGERATION)
		var box := instance.bake_mesh_from_current_blend_shape_mix().get_aabb()
		instance.set_blend_shape_value(shape, 0.0)
		var low := (box.position - target.rest.end) / _EXAGGERATION
		target.reaches.append(AABB(low, (box.end - target.rest.position) / _EXAGGERATION - low))
	_targets.append(target)
