extends "teller.gd"
## Drops a sphere onto a character of a running service with colliders: PORT, radius, place (x, y, z), seconds. Reports
## where it comes to rest, and what a ray of the physics engine from above hits.

var _puppet := Puppet3D.new()
var _sphere := RigidBody3D.new()
var _floor := 0.0
var _time := 0.0


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


func step(delta: float) -> bool:
	if _puppet.statistics()["sequence"] < 0:
		return false
	if _time == 0.0:
		_sphere.freeze = false
	_time += delta
	if _time < float(arguments()[5]):
		return false
	var ray := PhysicsRayQueryParameters3D.create(
		_sphere.position + Vector3.UP * 5.0, _sphere.position + Vector3.DOWN * 5.0
	)
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
