extends Camera3D
## A camera that plays shots in a loop and looks at a target. In each shot it moves from `From` to `To`.
##
## Each child of [member shots_at] is a shot, a [Node3D] with two children, `From` and `To`.

## Emitted at each cut.
signal cut(shot: String)

@export var shots_at: Node3D
@export var target: Node3D
## Duration of a shot, in seconds.
@export_range(1.0, 60.0, 0.5, "suffix:s") var seconds := 9.0

var _shot := 0
var _time := 0.0


func _process(delta: float) -> void:
	_time += delta
	if _time >= seconds:
		cut_to((_shot + 1) % shots())
	_place()


## Return the number of shots.
func shots() -> int:
	return shots_at.get_child_count()


## Cut to the beginning of a shot, counted from 0.
func cut_to(shot: int) -> void:
	_shot = clampi(shot, 0, shots() - 1)
	_time = 0.0
	_place()
	cut.emit(shots_at.get_child(_shot).name)


func _place() -> void:
	var shot := shots_at.get_child(_shot)
	var share := smoothstep(0.0, 1.0, _time / seconds)
	var from: Node3D = shot.get_node(^"From")
	var to: Node3D = shot.get_node(^"To")
	global_position = from.global_position.lerp(to.global_position, share)
	look_at(target.global_position)
