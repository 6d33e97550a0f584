extends "teller.gd"
## Base of the scripts that draw characters without a service, from a FOLDER with scene.bin, rest.bin, bent.bin,
## vertices.bin and vertices16.bin (payloads: scene, controls at rest and bent, vertices of the latter), which also
## receives the images.

const Message := preload("res://addons/puppetline/wire/message.gd")
const Scene := preload("res://addons/puppetline/wire/scene.gd")
const SceneResources := preload("res://addons/puppetline/play/scene_resources.gd")
const Body := preload("res://addons/puppetline/play/body.gd")
const ControlsBody := preload("res://addons/puppetline/play/controls_body.gd")
const VerticesBody := preload("res://addons/puppetline/play/vertices_body.gd")

var folder := ""
var stage: SubViewport
var camera: Camera3D
var resources: SceneResources


## Take the character of a folder.
func open(path: String) -> void:
	folder = path
	resources = SceneResources.new(Scene.parse(message("scene").payload))


## Show a frame with a material; null keeps the character's own.
func shown(body: Body, frame: String, material: Material) -> Body:
	body.set_materials([material])
	body.show_frames(message(frame), message(frame), 0.0)
	return body


## Save an image of a node, and free the node.
func photograph(what: Node3D, name: String) -> void:
	stage.add_child(what)
	await save(name)
	what.free()


## Save the second image of the stage: the first one of a new stage has no shadows with Vulkan.
func save(name: String) -> void:
	for _image in 2:
		await RenderingServer.frame_post_draw
	stage.get_texture().get_image().save_png("%s/%s.png" % [folder, name])


func make_stage() -> void:
	# Mesa's driver computes other depths before the image of Forward+ than in it, which leaves holes in all meshes.
	ProjectSettings.set_setting("rendering/driver/depth_prepass/enable", false)
	root.disable_3d = true
	RenderingServer.directional_shadow_atlas_set_size(1024, true)  # quicker on a processor
	DisplayServer.window_set_size(Vector2i(64, 64))
	stage = SubViewport.new()
	stage.size = Vector2i(240, 240)
	stage.own_world_3d = true
	stage.mesh_lod_threshold = 0.0  # all triangles, as in the meshes that are compared
	stage.render_target_update_mode = SubViewport.UPDATE_ALWAYS
	root.add_child(stage)
	var box := resources.scene.bounds
	camera = Camera3D.new()
	stage.add_child(camera)
	camera.fov = 34.0
	camera.look_at_from_position(box.get_center() + Vector3(0.5, 0.4, 1.3) * box.size.length(), box.get_center())
	camera.environment = Environment.new()
	camera.environment.background_mode = Environment.BG_COLOR
	camera.environment.background_color = Color(0.35, 0.4, 0.5)
	camera.environment.ambient_light_source = Environment.AMBIENT_SOURCE_COLOR
	camera.environment.ambient_light_color = Color(0.6, 0.7, 0.8)
	camera.environment.ambient_light_energy = 0.4
	var light := DirectionalLight3D.new()
	light.rotation_degrees = Vector3(-50, 35, 0)
	light.shadow_enabled = true
	light.light_energy = 0.6
	stage.add_child(light)
	var floor_plane := MeshInstance3D.new()
	floor_plane.mesh = PlaneMesh.new()
	floor_plane.mesh.size = 4.0 * Vector2(box.size.length(), box.size.length())
	floor_plane.position.y = box.position.y - 0.3
	stage.add_child(floor_plane)


## Return the mesh of the bent vertices.
func bent_mesh() -> ArrayMesh:
	var vertices := message("vertices").payload
	return mesh_of(_vectors(vertices.slice(0, vertices.size() / 2)), _vectors(vertices.slice(vertices.size() / 2)))


func mesh_of(positions: PackedVector3Array, normals: PackedVector3Array) -> ArrayMesh:
	var scene := resources.scene
	var arrays := resources.mesh.surface_get_arrays(0)
	var colors := PackedColorArray()
	for i in scene.colors.size() / 3:
		colors.append(Color(scene.colors[3 * i], scene.colors[3 * i + 1], scene.colors[3 * i + 2]))
	arrays[Mesh.ARRAY_VERTEX] = positions
	arrays[Mesh.ARRAY_NORMAL] = normals
	arrays[Mesh.ARRAY_COLOR] = null if colors.is_empty() else colors
	for custom in 3:
		arrays[Mesh.ARRAY_CUSTOM0 + custom] = null
	var mesh := ArrayMesh.new()
	mesh.add_surface_from_arrays(Mesh.PRIMITIVE_TRIANGLES, arrays)
	return mesh


func message(name: String) -> Message:
	var message := Message.new()
	message.payload = FileAccess.get_file_as_bytes("%s/%s.bin" % [folder, name])
	return message


func _vectors(bytes: PackedByteArray) -> PackedVector3Array:
	var numbers := bytes.to_float32_array()
	var vectors := PackedVector3Array()
	for i in range(0, numbers.size(), 3):
		vectors.append(Vector3(numbers[i], numbers[i + 1], numbers[i + 2]))
	return vectors
