extends RefCounted
## Computes the poses of patches of a shown character's surface. The data of each patch is kept for the next image.

const Scene := preload("../wire/scene.gd")
const Body := preload("body.gd")
const Playback := preload("playback.gd")
const SurfacePatch := preload("surface_patch.gd")
const PatchMotion := preload("patch_motion.gd")

## Maximum number of surface patches whose data is kept.
const _MAX_PATCHES := 1024

var _patches: Dictionary = {}  # vertex: SurfacePatch, of the scene
var _motions: Dictionary = {}  # SurfacePatch: PatchMotion, of the body


## Remove the data, because the character has changed.
func clear() -> void:
	_patches.clear()
	_motions.clear()


## Return the patch around a vertex of the scene.
func at_vertex(scene: Scene, vertex: int) -> SurfacePatch:
	if vertex not in _patches:
		_patches[vertex] = SurfacePatch.at_vertex(scene, vertex)
	return _patches[vertex]


## Return the shown pose of a patch, with an orthonormal basis in the space that [param to_space] transforms to. Before
## the first frame, it is the pose of the character.
func pose(patch: SurfacePatch, body: Body, shown: Playback, to_space: Transform3D) -> Transform3D:
	var unknown := Transform3D(Basis(to_space.basis.get_rotation_quaternion()), to_space.origin)
	if body == null or shown.earlier == null:
		return unknown
	if patch not in _motions:
		if _motions.size() >= _MAX_PATCHES:
			clear()
		_motions[patch] = body.follow_patch(patch)
	var motion: PatchMotion = _motions[patch]
	if motion == null:
		return unknown
	var share := body.shown_share(shown.share)
	var sums := motion.between(shown.earlier, shown.later, share)
	sums[0] += body.shift(shown.earlier, shown.later, share)
	return patch.pose(sums, to_space)
