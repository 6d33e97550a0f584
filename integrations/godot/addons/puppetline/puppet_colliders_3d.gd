@icon("icons/puppet_colliders_3d.svg")
class_name PuppetColliders3D
extends Node3D
## Makes bodies collide with a [Puppet3D], by about 48 boxes that cover the pieces of the character and move with it.
##
## The character pushes rigid bodies, and nothing pushes the character. A collision or a ray reports one of the bodies
## below this node. Only the mode CONTROLS has pieces.

## Smallest side of a box, in metres.
const _MIN_SIDE := 1e-3
## Relative change of a box's side after which its shape is changed.
const _SIZE_TOLERANCE := 0.02

## The character. If empty, the parent.
@export var puppet: Puppet3D:
	set(value):
		puppet = value
		_clear()
@export_flags_3d_physics var collision_layer := 1:
	set(value):
		collision_layer = value
		for body in _bodies:
			body.collision_layer = value
@export_flags_3d_physics var collision_mask := 1:
	set(value):
		collision_mask = value
		for body in _bodies:
			body.collision_mask = value
## Friction and bounce of the character.
@export var physics_material: PhysicsMaterial:
	set(value):
		physics_material = value
		for body in _bodies:
			body.physics_material_override = value

var _bodies: Array[AnimatableBody3D] = []
var _boxes: Array[AABB] = []
var _shapes: Array[BoxShape3D] = []
var _followed: Puppet3D


func _physics_process(_delta: float) -> void:
	var now := puppet if puppet != null else get_parent() as Puppet3D
	if now != _followed:
		_clear()
		_follow(now)
	if _followed == null:
		return
	var transforms := _followed.get_piece_transforms()
	if _bodies.is_empty() and not transforms.is_empty():
		_boxes = _followed.get_piece_boxes()
		_boxes.map(_add)
	if transforms.size() == _bodies.size():
		var space := _followed.global_transform
		for i in transforms.size():
			_move(i, space * transforms[i])


func _exit_tree() -> void:
	_clear()


func _follow(now: Puppet3D) -> void:
	_followed = now
	if _followed != null:
		_followed.scene_loaded.connect(_remove_bodies)


func _clear() -> void:
	_remove_bodies()
	if is_instance_valid(_followed):
		_followed.scene_loaded.disconnect(_remove_bodies)
	_followed = null


func _remove_bodies() -> void:
	for body in _bodies:
		body.queue_free()
	_bodies.clear()
	_shapes.clear()


func _add(_box: AABB) -> void:
	var body := AnimatableBody3D.new()
	var shape := CollisionShape3D.new()
	shape.shape = BoxShape3D.new()
	body.add_child(shape)
	body.sync_to_physics = false
	body.top_level = true
	body.collision_layer = collision_layer
	body.collision_mask = collision_mask
	body.physics_material_override = physics_material
	add_child(body, false, Node.INTERNAL_MODE_FRONT)
	_bodies.append(body)
	_shapes.append(shape.shape)


## Move a box. Physics requires bodies without scale and shear, so these become the lengths of its sides.
func _move(i: int, transform: Transform3D) -> void:
	var basis := transform.basis
	var size := _boxes[i].size * Vector3(basis.x.length(), basis.y.length(), basis.z.length())
	size = size.max(Vector3.ONE * _MIN_SIDE)
	var change := (size / _shapes[i].size - Vector3.ONE).abs()
	if change[change.max_axis_index()] > _SIZE_TOLERANCE:
		_shapes[i].size = size
	_bodies[i].global_transform = Transform3D(
		Basis(basis.get_rotation_quaternion()), transform * _boxes[i].get_center()
	)
