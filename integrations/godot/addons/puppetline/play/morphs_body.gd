extends "body.gd"
## A character that is deformed by the morph targets of a .glb from `puppetline bake`.

const OwnMesh := preload("own_mesh.gd")
const MorphMesh := preload("morph_mesh.gd")
const OwnTargets := preload("own_targets.gd")
const MorphsMotion := preload("morphs_motion.gd")

## Distance within which a vertex of the scene is found in the imported meshes, relative to the diagonal.
const _SEARCH_MARGIN := 1e-3

var _source: Node3D
var _rest_position := Vector3.ZERO  # of the source, which root motion is added to
var _meshes: Array[MorphMesh] = []
var _names: Array = []
var _own_targets: OwnTargets
var _earlier: Message  # its weights are in _from
var _later: Message
var _from := PackedFloat32Array()
var _to := PackedFloat32Array()
var _weights := PackedFloat32Array()


## [param source] is the character from `mesh_source`, which becomes a child of this node, or null.
func _init(of: SceneResources, source: Node3D) -> void:
	resources = of
	_source = source
	if source != null:
		add_child(source)
		_rest_position = source.position
	if resources.scene.morphs is Array:
		_names = resources.scene.morphs
	_weights.resize(_names.size())
	if _names.is_empty():
		problem = "the service has no morph targets for it; start it with --morphs and the .glb from `puppetline bake`"
	elif source == null:
		problem = "the mode MORPHS requires a mesh_source; import the .glb from `puppetline bake` and assign it"
	else:
		_find_targets()


func payload_name() -> String:
	return "morphs"


func frame_size() -> int:
	return 4 * (1 + _names.size())  # the residual comes before the weights


func set_materials(materials: Array[Material]) -> void:
	var surface := 0
	for mesh in _meshes:
		for i in mesh.own_materials.size():
			var given := materials[surface] if surface < materials.size() else null
			mesh.instance.set_surface_override_material(i, given if given != null else mesh.own_materials[i])
			surface += 1


func show_frames(earlier: Message, later: Message, share: float) -> void:
	if _earlier != earlier or _later != later:
		_earlier = earlier
		_later = later
		_from = earlier.payload.to_float32_array()
		_to = later.payload.to_float32_array()
	for i in _weights.size():
		_weights[i] = lerpf(_from[1 + i], _to[1 + i], share)
	for mesh in _meshes:
		mesh.set_weights(_weights)
	if _own_targets != null:
		_own_targets.show_frames(earlier, later, share)
	if _source != null:
		_source.position = _rest_position + shift(earlier, later, share)


## The targets do not include the root, which is in the axes and units of the source.
func shift(earlier: Message, later: Message, share: float) -> Vector3:
	if not follow_root:
		return Vector3.ZERO
	var root := earlier.root.lerp(later.root, share)
	return _source.basis * root if _source != null else root


func follow_patch(patch: SurfacePatch) -> PatchMotion:
	if _meshes.is_empty():
		return null
	var source := Transform3D(_source.basis, _rest_position)
	var to_rest := Transform3D(Basis.IDENTITY, _rest_position - _source.position)
	var box := AABB(source * resources.scene.positions[patch.vertices[0]], Vector3.ZERO)
	for vertex in patch.vertices:
		box = box.expand(source * resources.scene.positions[vertex])
	box = box.grow(_SEARCH_MARGIN * resources.scene.diagonal)
	var candidates: Array[MorphMesh.Vertex] = []
	for mesh in _meshes:
		candidates.append_array(mesh.vertices_in(box, to_rest * OwnMesh.transform_within(mesh.instance, _source)))
	return MorphsMotion.new(resources.scene, patch, candidates, source)


func intersect(from: Vector3, to: Vector3) -> Dictionary:
	var hit := {}
	for mesh in _meshes:
		var to_node := OwnMesh.transform_within(mesh.instance, _source)
		var faces: PackedVector3Array = to_node * mesh.instance.bake_mesh_from_current_blend_shape_mix().get_faces()
		for corner in range(0, faces.size(), 3):
			# Godot's triangles are clockwise.
			var corners := PackedVector3Array([faces[corner], faces[corner + 2], faces[corner + 1]])
			var position: Variant = SurfaceRay.segment_hit(corners, from, to, resources.scene.diagonal)
			if position != null:
				to = position
				hit = {"triangle": -1, "corners": corners, "position": position}
	return hit


## The order is that of the meshes and vertices from Godot's importer, which can differ from the scene's order.
func evaluate() -> PackedVector3Array:
	var positions := PackedVector3Array()
	for mesh in _meshes:
		positions.append_array(OwnMesh.transform_within(mesh.instance, _source) * mesh.positions())
	return positions


func _find_targets() -> void:
	var instances: Array[MeshInstance3D] = []
	for instance in OwnMesh.meshes_below(_source):
		var mesh := MorphMesh.new()
		mesh.instance = instance
		if mesh.find(_names):
			_meshes.append(mesh)
			instances.append(instance)
	_own_targets = OwnTargets.new(resources.scene, instances)
	if _meshes.is_empty():
		problem = (
			"no mesh in mesh_source has the morph targets of the service (%s); run `puppetline bake` again"
			% ", ".join(_names)
		)
