extends RefCounted
## A few vertices of a character around a point, and the weighted sums of their positions that determine a pose.
##
## Origin and axes of the pose are linear in the positions of the vertices, which are linear in each frame's data. A
## frame therefore takes a few sums for each pose, whatever the size of the mesh.

const SurfacePatch := preload("surface_patch.gd")
const Scene := preload("../wire/scene.gd")

## Maximum number of vertices around a point inside of the character.
const _MAX_VERTICES := 32
## Radius in which vertices around a point inside of the character are used, relative to the distance of the nearest
## one.
const _RADIUS := 1.4
## Length of the projected front axis below which the up axis defines the orientation.
const _MIN_PROJECTION := 0.3
## Square of a distance, relative to the largest one, that is added to each axis: a flat patch has no extent along one
## of them.
const _REGULARIZATION := 1e-4

var vertices := PackedInt32Array()
## Coefficients of the vertices, which sum up to the origin and to two deformed axes: the x axis of a surface or the y
## axis of a limb, and the z axis.
var to_origin := PackedFloat64Array()
var to_first := PackedFloat64Array()
var to_z := PackedFloat64Array()

var _in_limb := false


## Return the patch around a vertex: the vertex, its neighbours and theirs. The y axis points out of the surface, and
## the z axis to the front of the character at rest, or up where the surface faces the front.
static func at_vertex(scene: Scene, vertex: int) -> SurfacePatch:
	var patch := SurfacePatch.new()
	var normal := scene.normals[vertex]
	normal = normal.normalized() if normal.length_squared() > 0.0 else scene.up
	patch.vertices = _neighbours(scene, _neighbours(scene, PackedInt32Array([vertex])))
	# The vertex itself comes first.
	patch.vertices.remove_at(patch.vertices.find(vertex))
	patch.vertices.insert(0, vertex)
	var z := _within(scene, normal)
	patch._fit(scene, scene.positions[vertex], Basis(normal.cross(z), normal, z))
	patch.to_origin.fill(0.0)
	patch.to_origin[0] = 1.0
	return patch


## Return the patch around a point inside of a limb. The y axis points along the limb, and the z axis as above.
static func inside(scene: Scene, point: Vector3, direction: Vector3) -> SurfacePatch:
	var patch := SurfacePatch.new()
	patch._in_limb = true
	patch.vertices = _around(scene, point)
	var y := direction.normalized()
	var z := _within(scene, y)
	patch._fit(scene, point, Basis(y.cross(z), y, z))
	return patch


## Return the vertex that is closest to a point.
static func nearest(scene: Scene, point: Vector3) -> int:
	var best := 0
	var least := INF
	for vertex in scene.vertex_count:
		var distance := point.distance_squared_to(scene.positions[vertex])
		if distance < least:
			least = distance
			best = vertex
	return best


## Return the pose of summed positions (origin and two axes), transformed into another space. Its basis is orthonormal
## and right-handed, even if the space is scaled or mirrored.
func pose(sums: PackedVector3Array, to_space: Transform3D) -> Transform3D:
	var first := to_space.basis * sums[1]
	var z := to_space.basis * sums[2]
	var across := first.cross(z).normalized()
	first = first.normalized()
	var basis: Basis
	if _in_limb:
		basis = Basis(across, first, across.cross(first))
	else:
		# In a mirrored space, the cross product points into the surface.
		z = z.normalized()
		across = across if to_space.basis.determinant() < 0.0 else -across
		basis = Basis(across.cross(z), across, z)
	if not across.is_normalized():
		basis = Basis(to_space.basis.get_rotation_quaternion())
	return Transform3D(basis, to_space * sums[0])


## Fit a linear map of the rest positions, and determine its coefficients at the origin and along the axes of a basis.
func _fit(scene: Scene, origin: Vector3, axes: Basis) -> void:
	var local := PackedVector3Array()
	var mean := Vector3.ZERO
	for vertex in vertices:
		local.append((scene.positions[vertex] - origin) * axes)  # coordinates along the axes
		mean += local[-1] / vertices.size()
	var extent := 0.0
	for i in local.size():
		local[i] -= mean
		extent = maxf(extent, local[i].length())
	extent = maxf(extent, 1e-30)
	var squares := Basis(Vector3.ZERO, Vector3.ZERO, Vector3.ZERO)
	for offset in local:
		for axis in 3:
			squares[axis] += offset / extent * (offset[axis] / extent)
	for axis in 3:
		squares[axis][axis] += _REGULARIZATION
	var inverse := squares.inverse()
	for offset in local:
		var slopes := inverse * (offset / extent) / extent
		to_origin.append(1.0 / vertices.size() - slopes.dot(mean))
		to_first.append(slopes.y if _in_limb else slopes.x)
		to_z.append(slopes.z)


## Return the direction at right angles to an axis that is closest to the character's front.
static func _within(scene: Scene, axis: Vector3) -> Vector3:
	var z := scene.front.slide(axis)
	return (z if z.length() >= _MIN_PROJECTION else scene.up.slide(axis)).normalized()


## Return all vertices of the triangles that meet some vertices, including those of other parts at the same positions.
static func _neighbours(scene: Scene, of: PackedInt32Array) -> PackedInt32Array:
	var found: Dictionary = {}
	for vertex in of:
		var same := scene.positions.find(scene.positions[vertex])
		while same >= 0:
			found[same] = true
			var corner := scene.triangles.find(same)
			while corner >= 0:
				var first := corner - corner % 3
				for i in 3:
					found[scene.triangles[first + i]] = true
				corner = scene.triangles.find(same, first + 3)
			same = scene.positions.find(scene.positions[vertex], same + 1)
	return PackedInt32Array(found.keys())


## Return the vertices near a point, at most [constant _MAX_VERTICES] of them, evenly chosen.
static func _around(scene: Scene, point: Vector3) -> PackedInt32Array:
	var radius := _RADIUS * point.distance_to(scene.positions[nearest(scene, point)])
	var near := PackedInt32Array()
	for vertex in scene.vertex_count:
		if point.distance_squared_to(scene.positions[vertex]) <= radius * radius:
			near.append(vertex)
	var chosen := PackedInt32Array()
	var step := maxf(1.0, float(near.size()) / _MAX_VERTICES)
	for i in mini(near.size(), _MAX_VERTICES):
		chosen.append(near[int(i * step)])
	return chosen
