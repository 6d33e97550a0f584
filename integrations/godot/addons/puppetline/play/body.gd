extends Node3D
## What shows a character: what is common to the three ways in which it can be done.

const SharedScene := preload("shared_scene.gd")
const Message := preload("../wire/message.gd")

## The scene that belongs to the frames.
var shared: SharedScene
## Whether the character walks, or stays where it is.
var follow_root := true
## What is wrong, for people; empty if nothing is.
var problem := ""


## Return what has to be followed: the second half of the topic.
func word() -> String:
	return ""


## Return how many bytes of payload each frame must have.
func frame_size() -> int:
	return 0


## Put materials in the place of the character's own, by surface; null keeps the own.
func dress(_materials: Array[Material]) -> void:
	pass


## Show what lies between two frames, a share of the way from the earlier to the later one.
func show_frames(_earlier: Message, _later: Message, _share: float) -> void:
	pass


## Compute the positions that are shown just now, in the order of the scene and the space of this node.
func evaluate() -> PackedVector3Array:
	return PackedVector3Array()


## Return what has to be added to all that is shown between two frames.
func shift(earlier: Message, later: Message, share: float) -> Vector3:
	return Vector3.ZERO if follow_root else -earlier.root.lerp(later.root, share)
