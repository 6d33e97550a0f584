extends "teller.gd"
## Drops a sphere onto a character of a running service with colliders: PORT, radius, place (x, y, z), seconds. Reports
## where it comes to rest, and what a ray of the physics engine from above hits.

var _puppet := Puppet3D.new()
var _sphere := RigidBody3D.new()
var _dropped_at := 0


func start() -> void:
	var asked := arguments()
	_puppet.port = int(asked[0])
	var colliders := PuppetColliders3D.new()
	colliders.physics_material = PhysicsMaterial.new()
	_puppet.add_child(colliders)
	root.add_child(_puppet)
	var shape := CollisionShape3D.new()
	shape.shape = SphereShape3D.new()
	(shape.shape as SphereShape3D).radius = float(asked[1])
	_sphere.add_child(shape)
	_sphere.freeze = true
	_sphere.angular_damp = 5.0
	_sphere.position = Vector3(float(asked[2]), float(asked[3]), float(asked[4]))
	root.add_child(_sphere)


func step(_delta: float) -> bool:
	if _puppet.statistics()["sequence"] < 0:
		return false
	if _sphere.freeze:
		_sphere.freeze = false
		_dropped_at = Engine.get_physics_frames()
	if Engine.get_physics_frames() < _dropped_at + int(arguments()[5]) * Engine.physics_ticks_per_second:
		return false
	var beside := _sphere.position + Vector3(0.02, 0.0, 0.03)  # not between two boxes
	var ray := PhysicsRayQueryParameters3D.create(beside + Vector3.UP * 5.0, beside + Vector3.DOWN * 5.0)
	ray.exclude = [_sphere.get_rid()]
	var hit := root.world_3d.direct_space_state.intersect_ray(ray)
	var body: Node = hit.get("collider")
	tell(
		{
			"sphere": [_sphere.position.x, _sphere.position.y, _sphere.position.z],
			"speed": _sphere.linear_velocity.length(),
			"below": hit["position"].y if body != null else -1e9,
			"collider": body != null and body.get_parent() is PuppetColliders3D,
		}
	)
	_puppet.free()
	_sphere.free()
	return true
