extends RefCounted
## The morph targets that meshes have themselves and the service moves (docs/protocol.md, "Targets").

const Message := preload("../wire/message.gd")
const Scene := preload("../wire/scene.gd")


## The blend shape of a mesh that is a target.
class _Shape:
	var instance: MeshInstance3D
	var index: int
	var weight_at_rest: float
	## Index of the target in the scene's `targets`.
	var target: int


var _shapes: Array[_Shape] = []


## Find the targets of a scene in meshes, by their names.
func _init(scene: Scene, instances: Array[MeshInstance3D]) -> void:
	for target in scene.targets.size():
		for instance in instances:
			var index := instance.find_blend_shape_by_name(scene.targets[target])
			if index >= 0:
				var shape := _Shape.new()
				shape.instance = instance
				shape.index = index
				shape.weight_at_rest = instance.get_blend_shape_value(index)
				shape.target = target
				_shapes.append(shape)


## Set the weights between two frames: 0 is the weight at rest, 1 the whole target.
func show_frames(earlier: Message, later: Message, share: float, influence := 1.0) -> void:
	var count := mini(earlier.targets.size(), later.targets.size())
	for shape in _shapes:
		if shape.target < count and is_instance_valid(shape.instance):
			var weight := influence * lerpf(earlier.targets[shape.target], later.targets[shape.target], share)
			shape.instance.set_blend_shape_value(shape.index, lerpf(shape.weight_at_rest, 1.0, weight))


## Set the weights at rest again.
func reset() -> void:
	for shape in _shapes:
		if is_instance_valid(shape.instance):
			shape.instance.set_blend_shape_value(shape.index, shape.weight_at_rest)
