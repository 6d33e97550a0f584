extends RefCounted
## One version of a character's scene, and the resources made from it, which its nodes share.
##
## Each resource is made on first use, or in advance by [method make], which may run in a thread.

const Scene := preload("../wire/scene.gd")
const RestMesh := preload("rest_mesh.gd")
const IsolineBounds := preload("isoline_bounds.gd")
const SurfaceRay := preload("surface_ray.gd")

var scene: Scene
var mesh: ArrayMesh:
	get:
		if mesh == null:
			mesh = RestMesh.build(scene)
		return mesh
var rest_texture: ImageTexture:
	get:
		if rest_texture == null:
			rest_texture = RestMesh.rest_texture(scene)
		return rest_texture
var slopes_texture: ImageTexture:
	get:
		if slopes_texture == null:
			slopes_texture = RestMesh.slopes_texture(scene)
		return slopes_texture
var bounds: IsolineBounds:
	get:
		if bounds == null:
			bounds = IsolineBounds.new(scene)
		return bounds
var ray: SurfaceRay:
	get:
		if ray == null:
			ray = SurfaceRay.new(scene, bounds)
		return ray


func _init(of: Scene) -> void:
	scene = of


## Make the resources that the graphics card needs; the mesh only if it is shown.
func make(with_mesh: bool) -> void:
	if RestMesh.obstacle(scene).is_empty():
		bounds = IsolineBounds.new(scene)
		rest_texture = RestMesh.rest_texture(scene)
		slopes_texture = RestMesh.slopes_texture(scene)
	if with_mesh:
		mesh = RestMesh.build(scene)
