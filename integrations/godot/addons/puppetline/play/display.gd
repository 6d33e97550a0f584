extends RefCounted
## The nodes below a [Puppet3D] that show its character: the character of [member Puppet3D.mesh_source] at rest until a
## frame is shown, then the body that the frames move.

const RenderedNode := preload("rendered_node.gd")
const Body := preload("body.gd")
const Playback := preload("playback.gd")
const SurfacePatch := preload("surface_patch.gd")
const SurfacePoses := preload("surface_poses.gd")
const Scene := preload("../wire/scene.gd")

## The node that frames move; null before the scene has arrived.
var body: Body

var _puppet: RenderedNode
var _last_body: Body  # stays until the next one shows a frame
var _preview: Node3D
var _preview_stale := true
var _poses := SurfacePoses.new()


func _init(puppet: RenderedNode) -> void:
	_puppet = puppet


## Replace the body. The one before it stays until the new one shows a frame.
func set_body(next: Body) -> void:
	if body != null and _last_body == null:
		_last_body = body
	elif body != null:
		body.queue_free()
	body = next
	body.visible = false
	_poses.clear()
	_add(body)


## Remove the bodies.
func clear() -> void:
	for each: Body in [body, _last_body]:
		if each != null:
			each.queue_free()
	body = null
	_last_body = null
	reset_preview()


## Show the interpolation of two frames.
func show_frames(shown: Playback, is_visible: bool) -> void:
	body.show_frames(shown.earlier, shown.later, shown.share)
	body.visible = is_visible
	if _last_body != null:
		_last_body.queue_free()
		_last_body = null
	_hide_preview()


## Show the character that [param instantiate] returns, unless a frame has been shown. Nothing happens until the preview
## has been reset.
func show_preview(is_wanted: bool, instantiate: Callable) -> void:
	if not _preview_stale:
		return
	_preview_stale = false
	if is_wanted and _last_body == null and (body == null or not body.visible):
		_preview = instantiate.call()
		if _preview != null:
			_add(_preview)


## Remove the preview, and make it again if it is still needed.
func reset_preview() -> void:
	_hide_preview()
	_preview_stale = true


## Return the nodes whose meshes have the rendering properties of the puppet.
func nodes() -> Array[Node3D]:
	var found: Array[Node3D] = []
	for each: Node3D in [body, _preview]:
		if each != null:
			found.append(each)
	return found


## Return the patch around a vertex of the scene.
func patch_at(scene: Scene, vertex: int) -> SurfacePatch:
	return _poses.at_vertex(scene, vertex)


## Return the shown pose of a patch, with an orthonormal basis in the space that [param to_space] transforms to. Before
## the first frame, it is the pose of the character.
func patch_pose(patch: SurfacePatch, shown: Playback, to_space: Transform3D) -> Transform3D:
	return _poses.pose(patch, body, shown, to_space)


## Return where a segment in global coordinates hits the shown surface first: `position` and `normal` in global
## coordinates, and the number of the nearest `vertex` in the scene, or −1 if the triangles are not those of the scene.
## It is empty if nothing is hit.
func intersect(from: Vector3, to: Vector3) -> Dictionary:
	var to_global := _puppet.global_transform
	var into := to_global.affine_inverse()
	var hit := body.intersect(into * from, into * to) if body != null else {}
	if hit.is_empty():
		return {}
	var corners: PackedVector3Array = to_global * (hit["corners"] as PackedVector3Array)
	var normal := (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalized()
	var place: Vector3 = to_global * hit["position"]
	var nearest := 0
	for i in 3:
		if place.distance_squared_to(corners[i]) < place.distance_squared_to(corners[nearest]):
			nearest = i
	return {
		"position": place,
		"normal": -normal if to_global.basis.determinant() < 0.0 else normal,
		"vertex": body.resources.scene.triangles[3 * hit["triangle"] + nearest] if hit["triangle"] >= 0 else -1,
	}


func _add(node: Node3D) -> void:
	_puppet.add_child(node, false, Node.INTERNAL_MODE_FRONT)
	_puppet.pass_on_rendering()


func _hide_preview() -> void:
	if _preview != null:
		_preview.queue_free()
		_preview = null
