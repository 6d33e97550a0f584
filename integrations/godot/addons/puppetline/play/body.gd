extends Node3D
## Base of the three nodes that show a character: by controls, vertices or morph targets.

const SceneResources := preload("scene_resources.gd")
const Message := preload("../wire/message.gd")
const SurfacePatch := preload("surface_patch.gd")
const PatchMotion := preload("patch_motion.gd")
const SurfaceRay := preload("surface_ray.gd")

## The scene that belongs to the frames.
var resources: SceneResources
## Whether root motion moves the character, or it stays in place.
var follow_root := true
## Description of an error for the user; empty if there is none.
var problem := ""


## Return the second half of the topic to follow.
func payload_name() -> String:
	return ""


## Return the size that the payload of each frame must have, in bytes.
func frame_size() -> int:
	return 0


## Replace the materials of the character, by surface; null keeps the character's own.
func set_materials(_materials: Array[Material]) -> void:
	pass


## Show the interpolation of two frames: the earlier one at share 0, the later one at share 1.
func show_frames(_earlier: Message, _later: Message, _share: float) -> void:
	pass


## Compute the positions that are shown, in the order of the scene and the coordinates of this node.
func evaluate() -> PackedVector3Array:
	return PackedVector3Array()


## Return which interpolation of two frames is shown at a share.
func shown_share(share: float) -> float:
	return share


## Return the motion of a patch of the surface; null if the character does not move.
func follow_patch(_patch: SurfacePatch) -> PatchMotion:
	return null


## Return boxes that cover the pieces of the character at rest; empty if there are none.
func piece_boxes() -> Array[AABB]:
	return []


## Return the transform that moves each of these boxes to the shown pose; empty if there are none.
func piece_transforms() -> Array[Transform3D]:
	return []


## Return the nearest hit of the shown surface by a segment, in the coordinates of this node: the `position` and the
## `corners` of the triangle, and its number `triangle`, or −1 if the triangles are not those of the scene. It is empty
## if nothing is hit. This base tries all triangles.
func intersect(from: Vector3, to: Vector3) -> Dictionary:
	var hit := {}
	var positions := evaluate()
	for triangle in resources.scene.triangle_count if not positions.is_empty() else 0:
		var corners := PackedVector3Array()
		for i in 3:
			corners.append(positions[resources.scene.triangles[3 * triangle + i]])
		var position: Variant = SurfaceRay.segment_hit(corners, from, to, resources.scene.diagonal)
		if position != null:
			to = position
			hit = {"triangle": triangle, "corners": corners, "position": position}
	return hit


## Return the displacement that is added to the interpolation of two frames.
func shift(earlier: Message, later: Message, share: float) -> Vector3:
	return Vector3.ZERO if follow_root else -earlier.root.lerp(later.root, share)
