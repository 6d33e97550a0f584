@tool
extends MeshInstance3D
## A folded curtain around the back of a stage.

const STEPS_PER_FOLD := 12
const FOLD_DEPTH_METRES := 0.16

@export_range(1.0, 30.0, 0.1, "suffix:m") var radius := 6.2:
	set(value):
		radius = value
		_build()
@export_range(1.0, 20.0, 0.1, "suffix:m") var height := 7.0:
	set(value):
		height = value
		_build()
## Angle around the stage that the curtain covers.
@export_range(10.0, 360.0, 1.0, "degrees") var span := 260.0:
	set(value):
		span = value
		_build()
@export_range(1, 200) var folds := 72:
	set(value):
		folds = value
		_build()


func _ready() -> void:
	_build()


func _build() -> void:
	if not is_node_ready():
		return
	var surface := SurfaceTool.new()
	surface.begin(Mesh.PRIMITIVE_TRIANGLES)
	var columns := folds * STEPS_PER_FOLD
	for column: int in columns + 1:
		for top: int in 2:
			surface.add_vertex(_point(float(column) / columns, top))
	for column: int in columns:
		var corner := 2 * column
		for index: int in [corner, corner + 1, corner + 2, corner + 2, corner + 1, corner + 3]:
			surface.add_index(index)
	surface.generate_normals()
	mesh = surface.commit()


func _point(along: float, top: int) -> Vector3:
	var angle := deg_to_rad((along - 0.5) * span)
	# The folds are deeper at the bottom, because the curtain is fixed at the top only.
	var distance := radius + FOLD_DEPTH_METRES * (1.0 - 0.55 * top) * sin(TAU * folds * along)
	return Vector3(distance * sin(angle), height * top, -distance * cos(angle))
