@tool
extends MeshInstance3D
## A curtain in folds around the back of a stage.

const STEPS_A_FOLD := 12
const DEPTH := 0.16

@export_range(1.0, 30.0, 0.1, "suffix:m") var radius := 6.2:
	set(value):
		radius = value
		_hang()
@export_range(1.0, 20.0, 0.1, "suffix:m") var height := 7.0:
	set(value):
		height = value
		_hang()
## How far around the stage it goes.
@export_range(10.0, 360.0, 1.0, "degrees") var span := 260.0:
	set(value):
		span = value
		_hang()
@export_range(1, 200) var folds := 72:
	set(value):
		folds = value
		_hang()


func _ready() -> void:
	_hang()


func _hang() -> void:
	if not is_node_ready():
		return
	var surface := SurfaceTool.new()
	surface.begin(Mesh.PRIMITIVE_TRIANGLES)
	var columns := folds * STEPS_A_FOLD
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
	# folds are deeper below, where nothing holds them
	var distance := radius + DEPTH * (1.0 - 0.55 * top) * sin(TAU * folds * along)
	return Vector3(distance * sin(angle), height * top, -distance * cos(angle))
